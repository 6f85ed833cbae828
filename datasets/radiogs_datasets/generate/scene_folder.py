"""Writing a generated scene, and how it was made, as a folder in the TensoIR layout (``layouts.tensoir``)."""

# Mitsuba's types exist only once a variant is set, so annotations must not be evaluated here.
from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import mitsuba as mi
import numpy as np
import torch
from numpy.typing import NDArray

from radiogs_core.scene.colour import srgb_encode

from ..image_files import read_hdr, write_exr, write_hdr, write_png
from ..layouts.tensoir import TRAINING_LIGHT
from ..writing import psnr, write_display
from . import render
from .environments import LIGHTS
from .recipe import TEST_RATIO, Pictures, Pinhole, Recipe, pinhole


@dataclass(frozen=True)
class Split:
    """How many views, from which of the rig's cameras on, at how many samples a pixel; test views have every map."""

    name: str
    first: int
    views: int
    samples: int


def write_scene(
    recipe: Recipe, folder: Path, seed: int, pictures: Pictures, progress: Callable[[str, int, int], None] | None
) -> None:
    """See ``generate_scene``; ``folder`` exists and is empty."""
    render.start()
    lights = _write_lights(recipe, folder / "envmaps")
    train = Split("train", 0, recipe.train if pictures.train is None else pictures.train, pictures.samples)
    test = Split("test", train.views, pictures.test, TEST_RATIO * pictures.samples)
    total = train.views + test.views
    energy = np.zeros(2)
    for split in (train, test):
        frames = []
        for place in range(split.views):
            number = split.first + place
            view = folder / f"{split.name}_{place:03}"
            view.mkdir()
            camera = pinhole(recipe.rig, number, pictures.size)
            energy += write_view(lights, camera, split, pictures.depth, seed * total + number, view)
            frames.append({"file_path": f"./{view.name}/rgba", "transform_matrix": camera.to_world.tolist()})
            if progress is not None:
                progress(view.name, number + 1, total)
        table = {"camera_angle_x": float(np.radians(recipe.rig.field_of_view)), "frames": frames}
        (folder / f"transforms_{split.name}.json").write_text(json.dumps(table, indent=1) + "\n")
    scored = pinhole(recipe.rig, test.first, pictures.size)
    metadata = describe(recipe, lights[TRAINING_LIGHT], scored, pictures, seed, float(energy[0] / energy[1]), folder)
    (folder / "metadata.json").write_text(json.dumps(metadata, indent=1) + "\n")


def _write_lights(recipe: Recipe, folder: Path) -> dict[str, mi.Scene]:
    """The recipe under each of its lights, which are rendered as stored, because RGBE keeps only eight bits."""
    folder.mkdir()
    lights = {}
    for role, name in {TRAINING_LIGHT: recipe.training_light, **{name: name for name in recipe.relight}}.items():
        write_hdr(folder / f"{role}.hdr", LIGHTS[name].radiance())
        lights[role] = render.build(recipe, read_hdr(folder / f"{role}.hdr"))
    return lights


def write_view(
    lights: Mapping[str, mi.Scene], camera: Pinhole, split: Split, depth: int, seed: int, folder: Path
) -> NDArray[np.float64]:
    """Write a view; returns sums of its indirect and total radiance under the training light, zeros if for training."""
    full = render.radiance(lights[TRAINING_LIGHT], camera, split.samples, depth, seed)
    # One alpha for every map of the view.
    alpha = np.where(render.any_coverage(lights[TRAINING_LIGHT], camera), full[..., 3:], 0)
    write_display(folder / "rgba.png", full, full[..., 3:], alpha)
    if split.name != "test":
        return np.zeros(2)
    seen = render.surface(lights[TRAINING_LIGHT], camera)
    write_png(folder / "albedo.png", np.concatenate([seen.albedo, alpha], -1))
    write_png(folder / "normal.png", np.concatenate([seen.normal * 0.5 + 0.5, alpha], -1))
    write_png(folder / "roughness.png", seen.roughness)
    write_exr(folder / "depth.exr", seen.depth)
    direct = _direct(lights[TRAINING_LIGHT], camera, split, seed)
    indirect = np.where(alpha > 0, full[..., :3] - direct, 0)
    write_exr(folder / "direct.exr", np.where(alpha > 0, direct, 0))
    write_exr(folder / "indirect.exr", indirect)
    for light in lights.keys() - {TRAINING_LIGHT}:
        relit = render.radiance(lights[light], camera, split.samples, depth, seed)
        write_display(folder / f"rgba_{light}.png", relit, relit[..., 3:], alpha)
        relit_indirect = relit[..., :3] - _direct(lights[light], camera, split, seed)
        write_exr(folder / f"indirect_{light}.exr", np.where(alpha > 0, relit_indirect, 0))
    return np.array([indirect.sum(), full[..., :3].sum()], dtype=np.float64)


def _direct(scene: mi.Scene, camera: Pinhole, split: Split, seed: int) -> NDArray[np.float32]:
    """The part of a view's radiance that met one surface only; the seed of the whole makes the two comparable."""
    return render.radiance(scene, camera, split.samples, render.DIRECT_DEPTH, seed)[..., :3]


NOISE_SEEDS = (1_000_000, 1_000_001)
"""Two seeds that no view uses: their difference in display colour, multiplied by alpha, gives the noise floor."""

SHARE_SAMPLES, SHARE_SIZE = 256, 96
"""Samples a pixel, and the most pixels a side, for shares of energy, which are sums over a whole image."""


def describe(
    recipe: Recipe, scene: mi.Scene, camera: Pinhole, pictures: Pictures, seed: int, indirect_share: float, folder: Path
) -> dict[str, object]:
    """The metadata of a scene whose lights lie in ``folder``.

    Noise, and the shares of specular and shadowed light, are measured on the view of ``camera``; ``indirect_share`` is
    of the energy of all test views.
    """
    depth, scored = pictures.depth, TEST_RATIO * pictures.samples
    light = read_hdr(folder / "envmaps" / "training.hdr")
    small = replace(camera, size=min(camera.size, SHARE_SIZE))
    pictures_of_both = (render.radiance(scene, camera, scored, depth, each)[..., :3] for each in NOISE_SEEDS)
    shown = [srgb_encode(torch.from_numpy(each)).clamp(0, 1).numpy() for each in pictures_of_both]
    return {
        "scene": recipe.name,
        "purpose": recipe.purpose,
        "kind": recipe.kind,
        "choices": recipe.choices,
        "seed": seed,
        "samples": {"train": pictures.samples, "test": scored},
        "sampler": "multijitter",
        "depth": depth,
        "noise_floor_db": psnr(*shown),
        "indirect_share": round(indirect_share, 4),
        **{f"{name}_share": round(share, 4) for name, share in shares(recipe, light, small, depth).items()},
        "lights": {
            path.stem: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted((folder / "envmaps").iterdir())
        },
        "versions": {package: version(package) for package in ("mitsuba", "drjit", "numpy")},
    }


def shares(recipe: Recipe, light: NDArray[np.float32], camera: Pinhole, depth: int) -> dict[str, float]:
    """Parts of the energy that a view sees under a light.

    specular: share of all light that one surface scatters in its specular lobe (with all albedos zero). shadowed: share
    of the direct light that solids block from each other; a solid's shadow on itself does not count.
    """
    whole = render.build(recipe, light)
    full, direct = (_energy(whole, camera, depth) for depth in (depth, render.DIRECT_DEPTH))
    black = tuple(replace(solid, material=solid.material.without_diffuse()) for solid in recipe.solids)
    specular = _energy(render.build(replace(recipe, solids=black), light), camera, render.DIRECT_DEPTH)
    seen = render.surface(whole, camera)
    unshadowed = shadowed = 0.0
    for solid in recipe.solids:
        alone = render.build(replace(recipe, solids=(solid,)), light)
        own = render.surface(alone, camera)
        # Pixels that see this solid and nothing else.
        mine = (own.coverage == 1) & (seen.coverage == 1) & (np.abs(own.depth - seen.depth) < 1e-6)
        unshadowed += float((_energy(alone, camera, render.DIRECT_DEPTH) * mine).sum())
        shadowed += float((direct * mine).sum())
    return {"specular": float(specular.sum() / full.sum()), "shadowed": max(0.0, 1 - shadowed / unshadowed)}


def _energy(scene: mi.Scene, camera: Pinhole, depth: int) -> NDArray[np.float32]:
    return render.radiance(scene, camera, SHARE_SAMPLES, depth, 0)[..., :3].sum(-1, keepdims=True)
