"""The process: tasks come as lines of JSON on standard input, answers go as lines of JSON to a given file descriptor.

    python -c "... ; from in_blender.worker import serve; serve(DESCRIPTOR)"

Blender and its libraries print to standard output and standard error, so answers use a separate pipe. An answer is
``{"done": ...}`` or ``{"error": {"what", "why", "remedy"}}``; the process ends with its input.

A .blend file is opened without running its scripts. Cycles is set to be unbiased: nothing is clamped, blurred, denoised
or left out.
"""

import json
import math
import os
import sys
from typing import Any

import bpy
from mathutils import Matrix, Vector

from . import materials


class Unusable(Exception):
    """The file cannot be rendered: what, why, and what to do next."""

    def __init__(self, what: str, why: str, remedy: str) -> None:
        super().__init__(what)
        self.told = {"what": what, "why": why, "remedy": remedy}


def serve(descriptor: int) -> None:
    """Answer every line of standard input."""
    with os.fdopen(descriptor, "w", encoding="utf-8") as answers:
        for line in sys.stdin:
            try:
                answer: dict[str, Any] = {"done": _answer(json.loads(line))}
            except Unusable as error:
                answer = {"error": error.told}
            answers.write(json.dumps(answer) + "\n")
            answers.flush()


def _answer(task: dict[str, Any]) -> Any:
    kind = task["task"]
    if kind == "open":
        found = open_file(task["file"])
        prepare_cycles(task["device"], task["threads"])
        materials.declare()
        return found | materials.translate_all()
    if kind == "render":
        return take_picture(task)
    raise ValueError(kind)


SOLID_KINDS = frozenset({"MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD"})
"""Kinds of objects that have a surface."""

SHOWN = 12
"""Number of missing files that a message names; further ones are counted."""


def open_file(path: str) -> dict[str, Any]:
    """Open the file and describe it. Raises Unusable for an unreadable file, missing linked files, or no surface."""
    try:
        bpy.ops.wm.open_mainfile(filepath=path, load_ui=False, use_scripts=False)
    except RuntimeError as error:
        raise Unusable(
            f"{path} is no .blend file that Blender {bpy.app.version_string} can open",
            f"Blender says: {' '.join(str(error).split())[:300]}",
            "Open it in Blender, save it again, and give that file.",
        ) from error
    _require_linked_files(path)
    low, high, objects, instances = _extent()
    if not objects:
        raise Unusable(
            f"{path} has nothing to render",
            "No mesh, curve, text or point cloud of its active scene is visible in renders.",
            "Make the scene that is meant the active one and its objects visible in renders; save it again.",
        )
    scene = bpy.context.scene
    return {
        "blender": bpy.app.version_string,
        "scene": scene.name,
        "low": low,
        "high": high,
        "objects": objects,
        "instances": instances,
        "unit_scale": scene.unit_settings.scale_length,
        "unit_system": scene.unit_settings.system,
        "scripts": _scripts(),
        "lamps": sum(each.type == "LIGHT" for each in scene.objects),
        "cameras": sum(each.type == "CAMERA" for each in scene.objects),
        "volumes": sum(each.type == "VOLUME" for each in scene.objects),
        "other_scenes": len(bpy.data.scenes) - 1,
    }


def _require_linked_files(path: str) -> None:
    """Require every library, image, cache and font that the file names: without it Blender renders pink or nothing."""
    sources = [("library", each, each.filepath) for each in bpy.data.libraries]
    sources += [
        ("image", each, each.filepath)
        for each in bpy.data.images
        if each.source in ("FILE", "SEQUENCE") and not each.packed_file and each.users
    ]
    sources += [("cache", each, each.filepath) for each in bpy.data.cache_files]
    missing = sorted(
        f"{kind} '{each.name}': {named or 'no path'}"
        for kind, each, named in sources
        if not named or not os.path.isfile(bpy.path.abspath(named, library=each.library if kind != "library" else None))
    )
    if missing:
        listed = "; ".join(missing[:SHOWN]) + (f"; and {len(missing) - SHOWN} more" if len(missing) > SHOWN else "")
        raise Unusable(
            f"{path} links {len(missing)} files that are not there",
            listed,
            "Put them where the file looks, or in Blender: File > External Data > Pack Resources, and save it again.",
        )


def _extent() -> tuple[list[float], list[float], int, int]:
    """The box around all rendered surfaces, world units; numbers of their objects and instances."""
    low, high = [math.inf] * 3, [-math.inf] * 3
    objects, instances = set(), 0
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        thing = instance.object
        if thing.type not in SOLID_KINDS or thing.original.hide_render or not instance.show_self:
            continue
        if thing.type == "MESH" and not thing.data.polygons:
            continue
        objects.add(thing.name_full)
        instances += bool(instance.is_instance)
        for corner in thing.bound_box:
            placed = instance.matrix_world @ Vector(corner)
            low, high = [*map(min, low, placed)], [*map(max, high, placed)]
    return low, high, len(objects), instances


def _scripts() -> int:
    """Numbers of self-registering texts and of drivers with Python expressions; none of them was run."""
    texts = sum(bool(each.use_module) for each in bpy.data.texts)
    return texts + sum(
        driver.driver.type == "SCRIPTED" and not driver.driver.is_simple_expression
        for each in bpy.data.objects
        if each.animation_data
        for driver in each.animation_data.drivers
    )


LAYER = "layer"
"""Name given to the view layer, and so the first part of the names of a file's channels."""

UNBIASED = {
    "use_denoising": False,
    "use_adaptive_sampling": False,
    "sample_clamp_direct": 0.0,
    "sample_clamp_indirect": 0.0,
    "light_sampling_threshold": 0.0,
    "blur_glossy": 0.0,
    "use_fast_gi": False,
    "use_guiding": False,
    "caustics_reflective": True,
    "caustics_refractive": True,
    "film_exposure": 1.0,
    "film_transparent_glass": False,
    "pixel_filter_type": "BOX",
    "sampling_pattern": "TABULATED_SOBOL",
    "use_animated_seed": False,
    "auto_scrambling_distance": False,
    "scrambling_distance": 1.0,
    "use_camera_cull": False,
    "use_distance_cull": False,
    "texture_limit_render": "OFF",
    "shading_system": False,
    "direct_light_sampling_type": "MULTIPLE_IMPORTANCE_SAMPLING",
}
"""Settings of ``scene.cycles`` by name. Roulette stays: it is unbiased. OSL (``shading_system``) would run scripts."""

PASSES = (
    "combined", "normal", "emit", "diffuse_direct", "diffuse_indirect", "diffuse_color", "glossy_direct",
    "glossy_indirect", "glossy_color", "transmission_direct", "transmission_indirect", "transmission_color",
)  # fmt: skip
VOLUME_PASSES = ("volume_direct", "volume_indirect")


def prepare_cycles(device: str, threads: int) -> None:
    """Apply the settings that all pictures share. Raises Unusable if the device is missing."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    for name, value in UNBIASED.items():
        setattr(scene.cycles, name, value)
    render = scene.render
    render.film_transparent = True
    render.use_motion_blur = render.use_simplify = render.use_border = False
    render.use_compositing = render.use_sequencer = render.use_freestyle = False
    render.resolution_percentage = 100
    render.pixel_aspect_x = render.pixel_aspect_y = 1.0
    render.dither_intensity = 0.0
    render.use_file_extension = render.use_overwrite = True
    render.use_persistent_data = True
    render.threads_mode, render.threads = "FIXED", threads
    scene.view_settings.view_transform, scene.view_settings.look = "Raw", "None"
    scene.view_settings.exposure, scene.view_settings.gamma = 0.0, 1.0
    written = render.image_settings
    if hasattr(written, "media_type"):  # since Blender 5.0
        written.media_type = "MULTI_LAYER_IMAGE"
    written.file_format, written.color_depth, written.exr_codec = "OPEN_EXR_MULTILAYER", "32", "ZIP"
    for layer in scene.view_layers[1:]:
        layer.use = False
    layer = scene.view_layers[0]
    layer.name, layer.use = LAYER, True
    layer.samples = 0
    layer.material_override = layer.world_override = None
    for name in PASSES:
        setattr(layer, f"use_pass_{name}", True)
    for name in VOLUME_PASSES:
        setattr(layer.cycles, f"use_pass_{name}", True)
    for thing in scene.objects:
        if thing.type == "LIGHT":
            thing.hide_render = True
    _choose(scene, device)


def _choose(scene: Any, device: str) -> None:
    if device == "cpu":
        scene.cycles.device = "CPU"
        return
    preferences = bpy.context.preferences.addons["cycles"].preferences
    for kind in ("OPTIX", "CUDA"):
        try:
            preferences.compute_device_type = kind
        except TypeError:  # this Blender was built without it
            continue
        preferences.get_devices()
        found = [each for each in preferences.devices if each.type == kind]
        if found:
            for each in preferences.devices:
                each.use = each.type == kind
            scene.cycles.device = "GPU"
            return
    raise Unusable("Blender finds no CUDA device", "Cycles asked OptiX and CUDA for devices; neither has one.",
                   "Leave --device out to render on the CPU.")  # fmt: skip


CAMERA, WORLD = "radiogs-bench camera", "radiogs-bench world"
NEAR, FAR = 1e-3, 1e3
"""Clip distances as multiples of the camera's distance."""


def take_picture(task: dict[str, Any]) -> None:
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
    """Make the light the whole world, unless it is set already."""
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
