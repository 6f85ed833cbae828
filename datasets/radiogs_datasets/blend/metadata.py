"""What is kept beside a rendered .blend file: how it was made, its noise, and what the BRDF cannot say of it."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from radiogs_core.scene.colour import srgb_encode

from .cameras import Shot
from .passes import Maps
from .request import Request
from .studio import Studio

Metadata = dict[str, Any]

NOISY = ("image", "direct", "indirect", "incident_indirect", "albedo", "normal", "depth")
"""Maps whose noise floor is told."""

SMALLEST_SHARE = 1e-4
"""Of a view's energy, below which a feature is not told."""


def describe(
    request: Request, opened: Mapping[str, Any], views: Sequence[Shot], studio: Studio, state: Path
) -> Metadata:
    """The metadata of a scene whose views are done; noise and truncation are measured on its first test view."""
    measured = {shot.name: json.loads((state / f"{shot.name}.json").read_text(encoding="utf-8")) for shot in views}
    test = [measured[shot.name] for shot in views if shot.split == "test"]
    radiance = sum(each["radiance"] for each in test)
    scored = next(shot for shot in views if shot.split == "test")
    first, second = studio.take(scored), studio.take(scored, other_seed=True)
    deeper = studio.take(scored, bounces=2 * request.bounces)
    identity = request.identity()
    return {
        "scene": request.file.stem,
        "purpose": "rendered from a .blend file by Blender Cycles",
        **{name: identity[name] for name in ("seed", "samples", "bounces", "device", "file", "cameras")},
        "noise_floor_db": display_floor(first, second),
        "noise_floors_db": {name: floor(first, second, name) for name in NOISY},
        "energy_beyond_bounces": _share(float((deeper.image - first.image).sum()), float(deeper.image.sum())),
        "indirect_share": _share(sum(each["indirect"] for each in test), radiance),
        "largest_closure_error": max(each["closure"] for each in measured.values()),
        "views_of_nothing": [name for name, each in measured.items() if not each["covered"]],
        "energy_of_what_the_brdf_cannot_say": _features(test, radiance),
        "materials": opened["materials"],
        "materials_not_understood": opened["not_understood"],
        "opened": {name: opened[name] for name in OPENED},
        "lights": identity["lights"],
        "training_light": next(iter(request.light_files)),
        "versions": {"blender": opened["blender"], "numpy": np.__version__, "torch": torch.__version__},
    }


OPENED = ("scene", "low", "high", "objects", "instances", "unit_scale", "unit_system", "scripts", "lamps", "cameras",
          "volumes", "other_scenes")  # fmt: skip


def floor(first: Maps, second: Maps, name: str) -> float | None:
    """PSNR in dB of a map between two seeds, in its own values; None where they are equal."""
    return _psnr(getattr(first, name), getattr(second, name))


def display_floor(first: Maps, second: Maps) -> float | None:
    """PSNR in dB between two seeds in display colour, multiplied by alpha; None where they are equal."""
    shown = [srgb_encode(torch.from_numpy(each.image)).clamp(0, 1).numpy() for each in (first, second)]
    return _psnr(*shown)


def _psnr(first: np.ndarray, second: np.ndarray) -> float | None:
    error = float(np.square((first - second).astype(np.float64)).mean())
    return round(-10 * math.log10(error), 2) if error else None


def _share(part: float, whole: float) -> float:
    return round(part / whole, 4) if whole else 0.0


def _features(test: Sequence[Mapping[str, Any]], radiance: float) -> dict[str, float]:
    shares = {name: _share(sum(each["features"][name] for each in test), radiance) for name in test[0]["features"]}
    return {name: share for name, share in shares.items() if share >= SMALLEST_SHARE}
