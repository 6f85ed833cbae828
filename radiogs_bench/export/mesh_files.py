"""A textured mesh as a file of other programs: glTF 2.0 (binary, GLB) or OBJ with its materials, by trimesh.

Both have Y up, so the scene's upward direction is turned there; lengths stay world units. Base colour is display sRGB,
roughness perceptual (alpha_GGX = r^2) and linear, metalness 0, as the methods' BRDF has no metal.
"""

from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from jaxtyping import Float
from PIL import Image
from torch import Tensor

from radiogs_core.errors import UsageError
from radiogs_core.kernels.surfel.footprint import frames
from radiogs_core.own_files import fresh
from radiogs_core.surfels.viewer_files import upright

from ..extras import extra_library

if TYPE_CHECKING:
    from .textures import Textured

SUFFIX = {"gltf": ".glb", "obj": ".obj"}
"""The forms, and the ends of their files' names."""

UP = torch.tensor([0.0, 1.0, 0.0])
"""Upwards in glTF, and in OBJ where programs read it."""


def require_ready(form: str, path: Path) -> None:
    """Raise UsageError, before any work, where a library lacks, or programs would not know the file by its name."""
    for library in ("trimesh", "xatlas"):
        extra_library(library, f"{form} needs {library}", "mesh")
    if path.suffix.lower() != SUFFIX[form]:
        raise UsageError(
            f"a mesh as {form} would be written to '{path.name}'",
            f"Other programs recognise such a file by the end of its name, {SUFFIX[form]}.",
            f"Name it so:  --out {path.with_suffix(SUFFIX[form])}",
        )


def write_textured(made: "Textured", form: str, up: Float[Tensor, "3"], path: Path) -> list[Path]:
    """Write a form of ``SUFFIX``; returns its files, the mesh first. ``up``: the scene's upward direction, world.

    GLB holds its textures. OBJ has beside it NAME.mtl, NAME_base_color.png and NAME_roughness.png. Raises UsageError
    for a folder that is a link, and OSError.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    files = (_glb if form == "gltf" else _obj)(made, up, path)
    for name, content in files.items():
        fresh(path.with_name(name), path.parent).write_bytes(content)
    return [path.with_name(name) for name in files]


def _solid(made: "Textured", up: Float[Tensor, "3"], material: Any) -> Any:
    """The mesh of trimesh, which has the origin of texture coordinates in the lower left corner."""
    trimesh = import_module("trimesh")
    turn = frames(upright(up, UP)[None])[0].numpy().T
    return trimesh.Trimesh(
        made.shape.mesh.vertices @ turn,
        made.shape.mesh.faces,
        vertex_normals=made.shape.normals @ turn,
        visual=trimesh.visual.TextureVisuals(made.shape.uv * [1, -1] + [0, 1], material=material),
        process=False,
    )


def _glb(made: "Textured", up: Float[Tensor, "3"], path: Path) -> dict[str, bytes]:
    trimesh = import_module("trimesh")
    # Occlusion (red), which nothing refers to, roughness (green) and metalness (blue).
    whole, none = np.full_like(made.roughness, 255), np.zeros_like(made.roughness)
    material = trimesh.visual.material.PBRMaterial(
        name="surface",
        baseColorTexture=Image.fromarray(made.base_colour),
        metallicRoughnessTexture=Image.fromarray(np.stack([whole, made.roughness, none], -1)),
        metallicFactor=0.0,
        roughnessFactor=1.0,
    )
    return {path.name: trimesh.Scene([_solid(made, up, material)]).export(file_type="glb", include_normals=True)}


def _obj(made: "Textured", up: Float[Tensor, "3"], path: Path) -> dict[str, bytes]:
    trimesh = import_module("trimesh")
    # Readers end the name of a file at a space.
    stem = path.stem.replace(" ", "_")
    material = trimesh.visual.material.SimpleMaterial(
        Image.fromarray(made.base_colour), name=f"{stem}_base_color", diffuse=[255] * 4, specular=[128] * 4
    )
    materials = f"{stem}.mtl"
    text, files = trimesh.exchange.obj.export_obj(
        _solid(made, up, material), include_normals=True, mtl_name=materials, return_texture=True, header=None
    )
    roughness = BytesIO()
    Image.fromarray(made.roughness).save(roughness, "PNG")
    files[materials] += f"\nPm 0\nPr 1\nmap_Pr {stem}_roughness.png\n".encode()
    return {path.name: text.encode(), **files, f"{stem}_roughness.png": roughness.getvalue()}
