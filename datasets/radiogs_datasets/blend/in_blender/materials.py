"""Materials of the open file as outputs of the renderer (AOVs), written beside each picture.

They are ``albedo``, ``roughness``, z-depth, ``known`` (1 where the node tree was translated), and a weight for each of
FEATURES (``shaders``).
"""

from typing import Any

import bpy

from .features import FEATURES
from .shaders import NotUnderstood, surface
from .values import Arithmetic

VALUES = ("roughness", "depth", "known", *FEATURES)
COLOURS = ("albedo",)

UNCOLOURED = 0.8
"""Albedo of a surface without a material, as Blender draws it."""


def declare() -> None:
    """Declare the outputs of all materials to the view layer."""
    layer = bpy.context.scene.view_layers[0]
    for names, kind in ((COLOURS, "COLOR"), (VALUES, "VALUE")):
        for name in names:
            output = layer.aovs.add()
            output.name, output.type = name, kind


def translate_all() -> dict[str, Any]:
    """Add the outputs to every material; returns how many were translated, and the types of the nodes that were not."""
    _give_every_surface_a_material()
    unknown: dict[str, int] = {}
    found = [each for each in bpy.data.materials if each.users and each.node_tree and not each.grease_pencil]
    for material in found:
        kind = _translate(material)
        if kind is not None:
            unknown[kind] = unknown.get(kind, 0) + 1
    return {"materials": len(found), "not_understood": unknown}


def _translate(material: Any) -> str | None:
    """Add the outputs to one material; returns the type of the node that could not be translated, if any."""
    tree = material.node_tree
    maths = Arithmetic(tree)
    camera = tree.nodes.new("ShaderNodeCameraData")
    maths.write("depth", camera.outputs["View Z Depth"])
    output = tree.get_output_node("CYCLES") or tree.get_output_node("ALL")
    if output is None:
        return None
    for name, socket in (("volume", "Volume"), ("displacement", "Displacement")):
        if output.inputs[socket].is_linked:
            maths.write(name, 1.0)
    if not output.inputs["Surface"].is_linked:
        return None
    try:
        said = surface(output.inputs["Surface"], maths)
    except NotUnderstood as error:
        return str(error)
    maths.write("known", 1.0)
    maths.write("albedo", said.albedo)
    maths.write("roughness", said.roughness)
    for name, weight in said.features.items():
        if weight != 0.0:
            maths.write(name, weight)
    return None


def _give_every_surface_a_material() -> None:
    plain = bpy.data.materials.new("no material")
    tree = plain.node_tree
    if tree is None:  # before Blender 5.0
        plain.use_nodes = True
        tree = plain.node_tree
    tree.nodes.clear()
    shader, output = (tree.nodes.new(kind) for kind in ("ShaderNodeBsdfDiffuse", "ShaderNodeOutputMaterial"))
    shader.inputs["Color"].default_value = (UNCOLOURED, UNCOLOURED, UNCOLOURED, 1.0)
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    for thing in bpy.data.objects:
        slots = getattr(thing.data, "materials", None)
        if slots is None or thing.library or thing.data.library:
            continue
        if not len(slots):
            slots.append(plain)
        for slot in thing.material_slots:
            if slot.material is None:
                slot.material = plain
