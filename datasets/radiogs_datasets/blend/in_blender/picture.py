"""One picture: the light around the scene, the camera, the samples."""

from typing import Any

import bpy
from mathutils import Matrix

CAMERA, WORLD = "radiogs-bench camera", "radiogs-bench world"
NEAR, FAR = 1e-3, 1e3
"""Clip distances as multiples of the camera's distance."""


def take(task: dict[str, Any]) -> None:
    """Render ``task["out"]``, a multi-layer OpenEXR file.

    light: an OpenEXR file, lat-long, Z up; camera: camera-to-world in OpenGL axes, rows; field_of_view: radians;
    size: pixels a side; samples a pixel; bounces: after the first surface; seed; distance: of the camera from what it
    looks at, world units.
    """
    scene = bpy.context.scene
    _light(scene, task["light"])
    _camera(scene, task)
    scene.render.resolution_x = scene.render.resolution_y = task["size"]
    settings = scene.cycles
    settings.samples, settings.seed = task["samples"], task["seed"]
    settings.filter_width = 1.0
    settings.max_bounces = task["bounces"]
    for kind in ("diffuse", "glossy", "transmission"):
        setattr(settings, f"{kind}_bounces", task["bounces"])
    settings.transparent_max_bounces = max(64, task["bounces"])
    scene.render.filepath = task["out"]
    bpy.ops.render.render(write_still=True, scene=scene.name)


def _camera(scene: Any, task: dict[str, Any]) -> None:
    placed = bpy.data.objects.get(CAMERA)
    if placed is None:
        placed = bpy.data.objects.new(CAMERA, bpy.data.cameras.new(CAMERA))
        scene.collection.objects.link(placed)
        scene.camera = placed
    lens = placed.data
    lens.type, lens.sensor_fit = "PERSP", "HORIZONTAL"
    lens.angle = task["field_of_view"]
    lens.shift_x = lens.shift_y = 0.0
    lens.clip_start, lens.clip_end = task["distance"] * NEAR, task["distance"] * FAR
    lens.dof.use_dof = False
    # A plain list would be taken as columns.
    placed.matrix_world = Matrix(task["camera"])


def _light(scene: Any, path: str) -> None:
    """The world is the light and nothing else; a light that is already up stays."""
    if scene.world is not None and scene.world.name == WORLD and scene.world.get("light") == path:
        return
    world = bpy.data.worlds.get(WORLD) or bpy.data.worlds.new(WORLD)
    if world.node_tree is None:  # before Blender 5.0
        world.use_nodes = True
    tree = world.node_tree
    tree.nodes.clear()
    image = bpy.data.images.load(path, check_existing=True)
    image.colorspace_settings.name = "Non-Color"
    kinds = ("ShaderNodeTexEnvironment", "ShaderNodeBackground", "ShaderNodeOutputWorld")
    texture, background, output = (tree.nodes.new(kind) for kind in kinds)
    texture.image, texture.interpolation, texture.projection = image, "Linear", "EQUIRECTANGULAR"
    tree.links.new(texture.outputs["Color"], background.inputs["Color"])
    tree.links.new(background.outputs["Background"], output.inputs["Surface"])
    world["light"] = path
    world.cycles.sampling_method = "AUTOMATIC"
    scene.world = world
