"""LPIPS v0.1 (Zhang et al. 2018) on AlexNet features, with the published weights or not at all."""

import os
from functools import cache
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import conv2d, max_pool2d, relu

WEIGHTS_VARIABLE = "RADIOGS_BENCH_WEIGHTS"
BACKBONES = ("alexnet_features.npz", "alexnet-owt-7be5be79.pth")
HEADS = ("heads/alex.pth", "alex.pth")
LAYERS = ((0, 4, 2), (3, 1, 2), (6, 1, 1), (8, 1, 1), (10, 1, 1))
"""Convolutions of torchvision's AlexNet: index, stride, padding; a 3 x 3 pool of stride 2 stands before 3 and 6."""

POOL_BEFORE = (3, 6)
SHIFT = (-0.030, -0.088, -0.188)
SCALE = (0.458, 0.448, 0.450)
"""ImageNet's statistics for inputs in [-1, 1]."""

UNIT_GUARD = 1e-10
"""The reference implementation's guard against features that are zero in all channels."""

SMALLEST_SIDE = 31
"""Below this the second pool has nothing to look at."""


def weights_folder() -> Path:
    """Where weights are looked for: the variable RADIOGS_BENCH_WEIGHTS, else the user's cache."""
    named = os.environ.get(WEIGHTS_VARIABLE)
    cache_home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return Path(named) if named else cache_home / "radiogs-bench" / "weights"


def missing_weights() -> str:
    """Why LPIPS cannot be computed here, or nothing."""
    folder = weights_folder()
    if _first(folder, BACKBONES) is None:
        return f"LPIPS weights not found: {folder} has neither {' nor '.join(BACKBONES)}"
    if _first(folder, HEADS) is None:
        return f"LPIPS weights not found: {folder} has neither {' nor '.join(HEADS)}"
    return ""


def lpips(image: Float[Tensor, "height width 3"], target: Float[Tensor, "height width 3"]) -> float:
    """Distance of two display-sRGB images in [0, 1]; 0 for identical ones. Needs ``missing_weights() == ""``."""
    features, heads = _network(weights_folder())
    total = 0.0
    for ours, theirs, head in zip(_layers(image, features), _layers(target, features), heads, strict=True):
        total += float(conv2d((_unit(ours) - _unit(theirs)).square(), head).mean())
    return total


def _unit(value: Tensor) -> Tensor:
    return value / (value.square().sum(1, keepdim=True).sqrt() + UNIT_GUARD)


def _layers(image: Tensor, features: dict[str, Tensor]) -> list[Tensor]:
    shift, scale = torch.tensor(SHIFT), torch.tensor(SCALE)
    value = ((2 * image.cpu().float() - 1 - shift) / scale).permute(2, 0, 1)[None]
    found = []
    for index, stride, padding in LAYERS:
        if index in POOL_BEFORE:
            value = max_pool2d(value, 3, 2)
        weight, bias = features[f"features.{index}.weight"], features[f"features.{index}.bias"]
        value = relu(conv2d(value, weight, bias, stride, padding))
        found.append(value)
    return found


@cache
def _network(folder: Path) -> tuple[dict[str, Tensor], list[Tensor]]:
    backbone, heads = _first(folder, BACKBONES), _first(folder, HEADS)
    if backbone is None or heads is None:
        raise FileNotFoundError(missing_weights())
    if backbone.suffix == ".npz":
        with np.load(backbone) as archive:
            features = {name: torch.from_numpy(archive[name]) for name in archive.files}
    else:
        features = torch.load(backbone, map_location="cpu", weights_only=True)
    loaded = torch.load(heads, map_location="cpu", weights_only=True)
    return features, [loaded[f"lin{layer}.model.1.weight"].float() for layer in range(len(LAYERS))]


def _first(folder: Path, names: tuple[str, ...]) -> Path | None:
    return next((folder / name for name in names if (folder / name).is_file()), None)
