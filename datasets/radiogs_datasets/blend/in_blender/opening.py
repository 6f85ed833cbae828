"""Opening a .blend file without running what is in it, and saying what it holds."""

import math
import os
from typing import Any

import bpy
from mathutils import Vector

from .errors import Unusable

SOLID_KINDS = frozenset({"MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD"})
"""Kinds of objects that have a surface."""

SHOWN = 12
"""Missing files that are named; the others are counted."""


def open_file(path: str) -> dict[str, Any]:
    """Open the file and describe it. Raises Unusable for one that cannot be read, lacks files, or has no surface.

    Neither scripts nor Python drivers in it are run.
    """
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
    """Every library, image, cache and font that the file names must be there: Blender renders pink or nothing else."""
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
    """The box around all that has a surface and is rendered, world units; how many objects, how many instances."""
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
    """How many texts would register themselves and how many drivers are Python: none of them was run."""
    texts = sum(bool(each.use_module) for each in bpy.data.texts)
    return texts + sum(
        driver.driver.type == "SCRIPTED" and not driver.driver.is_simple_expression
        for each in bpy.data.objects
        if each.animation_data
        for driver in each.animation_data.drivers
    )
