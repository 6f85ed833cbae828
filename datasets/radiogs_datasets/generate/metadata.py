"""What is kept beside a generated scene: how it was made, and how much noise and indirect light it holds."""

# Mitsuba's types exist only once a variant is set, so annotations must not be evaluated here.
from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import mitsuba as mi
import numpy as np
import torch
from numpy.typing import NDArray

from radiogs_core.scene.colour import srgb_encode

from ..image_files import read_hdr
from . import render
from .cameras import Pinhole
from .recipe import Recipe

NOISE_SEEDS = (1_000_000, 1_000_001)
"""Seeds that no view uses."""

SHARE_SAMPLES, SHARE_SIZE = 256, 96
"""Samples a pixel, and the most pixels a side, for shares of energy, which are sums over a whole image."""


@dataclass(frozen=True)
class Making:
    """How a scene was made: bounces, samples a pixel by split, seed; the indirect share of its test views' energy."""

    depth: int
    samples: Mapping[str, int]
    seed: int
    indirect_share: float


def describe(
    recipe: Recipe,
    scene: mi.Scene,
    camera: Pinhole,
    made: Making,
    folder: Path,
) -> dict[str, object]:
    """The metadata of a scene whose lights lie in ``folder``.

    Noise, and the shares of specular and shadowed light, are measured on the view of ``camera``.
    """
    depth, samples = made.depth, made.samples
    light = read_hdr(folder / "envmaps" / "training.hdr")
    small = replace(camera, size=min(camera.size, SHARE_SIZE))
    return {
        "scene": recipe.name,
        "purpose": recipe.purpose,
        "seed": made.seed,
        "samples": dict(samples),
        "sampler": "multijitter",
        "depth": depth,
        "noise_floor_db": round(noise_floor(scene, camera, samples["test"], depth), 2),
        "indirect_share": round(made.indirect_share, 4),
        **{f"{name}_share": round(share, 4) for name, share in shares(recipe, light, small, depth).items()},
        "lights": {
            path.stem: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted((folder / "envmaps").iterdir())
        },
        "versions": {package: version(package) for package in ("mitsuba", "drjit", "numpy")},
    }


def noise_floor(scene: mi.Scene, camera: Pinhole, samples: int, depth: int) -> float:
    """PSNR in dB between two renderings with different seeds, in display colour, multiplied by alpha."""
    first, second = (
        srgb_encode(torch.from_numpy(render.radiance(scene, camera, samples, depth, seed)[..., :3])).clamp(0, 1)
        for seed in NOISE_SEEDS
    )
    return -10 * math.log10(float((first - second).double().square().mean()))


def shares(recipe: Recipe, light: NDArray[np.float32], camera: Pinhole, depth: int) -> dict[str, float]:
    """Parts of the energy that a view sees under a light.

    specular: what one surface scatters in its specular lobe (all albedos set to zero), of all light. shadowed: what
    solids take away from one another's direct light, of the direct light that there would be without; the shadow of a
    knot on itself does not count.
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
    return {
        "specular": float(specular.sum() / full.sum()),
        "shadowed": max(0.0, 1 - shadowed / unshadowed),
    }


def _energy(scene: mi.Scene, camera: Pinhole, depth: int) -> NDArray[np.float32]:
    return render.radiance(scene, camera, SHARE_SAMPLES, depth, 0)[..., :3].sum(-1, keepdims=True)
