"""What is kept beside a generated scene: how it was made, and how much noise and indirect light it holds."""

# Mitsuba's types exist only once a variant is set, so annotations must not be evaluated here.
from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

import mitsuba as mi
import torch

from radiogs.colour import srgb_encode

from . import render
from .cameras import Pinhole
from .catalogue import Recipe

NOISE_SEEDS = (1_000_000, 1_000_001)
"""Seeds that no view uses."""


def describe(
    recipe: Recipe,
    scene: mi.Scene,
    camera: Pinhole,
    samples: Mapping[str, int],
    seed: int,
    indirect_share: float,
    folder: Path,
) -> dict[str, object]:
    """The metadata of a scene whose lights lie in ``folder``; its noise is measured on the view of ``camera``."""
    return {
        "scene": recipe.name,
        "purpose": recipe.purpose,
        "seed": seed,
        "samples": dict(samples),
        "sampler": "multijitter",
        "depth": render.GLOBAL_DEPTH,
        "noise_floor_db": round(noise_floor(scene, camera, samples["test"]), 2),
        "indirect_share": round(indirect_share, 4),
        "lights": {
            path.stem: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted((folder / "envmaps").iterdir())
        },
        "versions": {package: version(package) for package in ("mitsuba", "drjit", "numpy")},
    }


def noise_floor(scene: mi.Scene, camera: Pinhole, samples: int) -> float:
    """PSNR in dB between two renderings with different seeds, in display colour, multiplied by alpha."""
    first, second = (
        srgb_encode(
            torch.from_numpy(render.radiance(scene, camera, samples, render.GLOBAL_DEPTH, seed)[..., :3])
        ).clamp(0, 1)
        for seed in NOISE_SEEDS
    )
    return -10 * math.log10(float((first - second).double().square().mean()))
