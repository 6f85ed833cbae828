"""Writes a .blend file of plain solids: boxes and spheres, copied by modifiers and as instances of a collection.

    PYTHON docs/examples/solids_in_blender.py FILE < PARTS

PYTHON has ``bpy``; PARTS is a JSON list of what ``cycles_against_mitsuba.Part.description`` returns.
"""

import json
import math
import sys
from typing import Any

import bpy

AROUND, UPWARDS = 256, 128
"""Faces of a sphere along and across; flat, so that its normals are its faces'."""


def write(parts: list[dict[str, Any]], out: str) -> None:
    """Write the file."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for part in parts:
        _place(part)
    bpy.ops.wm.save_as_mainfile(filepath=out, compress=True)


def _place(part: dict[str, Any]) -> None:
    """One solid, as often as its array says; or as instances of a collection at several places."""
    mesh = bpy.data.meshes.new(part["name"])
    mesh.from_pydata(*(_box(part["low"], part["high"]) if part["kind"] == "box" else _ball(part["radius"])))
    mesh.materials.append(_material(part))
    thing = bpy.data.objects.new(part["name"], mesh)
    thing.location = part.get("centre", (0.0, 0.0, 0.0))
    scene = bpy.context.scene
    if "array" in part:
        many = thing.modifiers.new("array", "ARRAY")
        many.count = part["array"]["count"]
        many.use_relative_offset, many.use_constant_offset = False, True
        many.constant_offset_displace = part["array"]["step"]
    if "mirror" in part:
        many = thing.modifiers.new("mirror", "MIRROR")
        many.use_axis = [axis == part["mirror"] for axis in range(3)]
        many.use_mirror_merge = False
    if "instances" not in part:
        scene.collection.objects.link(thing)
        return
    collection = bpy.data.collections.new(part["name"])
    thing.location = (0.0, 0.0, 0.0)
    collection.objects.link(thing)
    for number, (place, scale) in enumerate(part["instances"]):
        instance = bpy.data.objects.new(f"{part['name']} {number}", None)
        instance.instance_type, instance.instance_collection = "COLLECTION", collection
        instance.location, instance.scale = place, (scale, scale, scale)
        scene.collection.objects.link(instance)


def _material(part: dict[str, Any]) -> Any:
    given = part["material"]
    made = bpy.data.materials.new(part["name"])
    if made.node_tree is None:  # before Blender 5.0
        made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    shader = tree.nodes.new("ShaderNodeBsdfPrincipled" if given["specular"] else "ShaderNodeBsdfDiffuse")
    if given["specular"]:
        shader.inputs["Roughness"].default_value = given["roughness"]
    colour = shader.inputs["Base Color" if given["specular"] else "Color"]
    colour.default_value = (*given["albedo"], 1.0)
    if "checker" in given:
        tree.links.new(_checker(tree, given), colour)
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return made


def _checker(tree: Any, given: dict[str, Any]) -> Any:
    """Cubes in world space: Blender's texture has its second colour where the cells' numbers add up to an even one."""
    place, offset, checker = (
        tree.nodes.new(kind) for kind in ("ShaderNodeNewGeometry", "ShaderNodeVectorMath", "ShaderNodeTexChecker")
    )
    offset.operation = "SUBTRACT"
    offset.inputs[1].default_value = given["checker"]["origin"]
    checker.inputs["Scale"].default_value = 1 / given["checker"]["side"]
    checker.inputs["Color1"].default_value = (*given["checker"]["second"], 1.0)
    checker.inputs["Color2"].default_value = (*given["albedo"], 1.0)
    tree.links.new(place.outputs["Position"], offset.inputs[0])
    tree.links.new(offset.outputs[0], checker.inputs["Vector"])
    return checker.outputs["Color"]


def _box(low: list[float], high: list[float]) -> tuple[list[Any], list[Any], list[Any]]:
    corners = [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, [], sides


def _ball(radius: float) -> tuple[list[Any], list[Any], list[Any]]:
    points = [(0.0, 0.0, radius), (0.0, 0.0, -radius)]
    for ring in range(1, UPWARDS):
        angle = math.pi * ring / UPWARDS
        for turn in range(AROUND):
            azimuth = 2 * math.pi * turn / AROUND
            flat = radius * math.sin(angle)
            points.append((flat * math.cos(azimuth), flat * math.sin(azimuth), radius * math.cos(angle)))

    def at(ring: int, turn: int) -> int:
        return 2 + (ring - 1) * AROUND + turn % AROUND

    faces: list[tuple[int, ...]] = [(0, at(1, turn), at(1, turn + 1)) for turn in range(AROUND)]
    for ring in range(1, UPWARDS - 1):
        faces += [
            (at(ring, turn), at(ring + 1, turn), at(ring + 1, turn + 1), at(ring, turn + 1)) for turn in range(AROUND)
        ]
    faces += [(1, at(UPWARDS - 1, turn + 1), at(UPWARDS - 1, turn)) for turn in range(AROUND)]
    return points, [], faces


if __name__ == "__main__":
    write(json.load(sys.stdin), sys.argv[1])
