"""LPIPS v0.1 (Zhang et al. 2018), only with the published weights."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import conv2d

from radiogs_core.errors import DataError

from .backbones import BACKBONES
from .conventions import Lpips, Net
from .weights import DOWNLOAD, read_weights, weights_folder

ALEX = Lpips()
"""AlexNet on [-1, 1], as published."""

SHIFT = (-0.030, -0.088, -0.188)
SCALE = (0.458, 0.448, 0.450)
"""ImageNet's statistics for inputs in [-1, 1]."""

UNIT_GUARD = 1e-10
"""The reference implementation's guard against features that are zero in all channels."""

SMALLEST_SIDE: Mapping[Net, int] = {"alex": 31, "vgg": 16, "squeeze": 31}
"""Smallest image side in pixels for which the last pool has input (SqueezeNet uses AlexNet's)."""


def lpips(
    image: Float[Tensor, "height width 3"], target: Float[Tensor, "height width 3"], rules: Lpips = ALEX
) -> float:
    """Distance of two images in [0, 1], display sRGB as a rule; 0 for identical ones.

    Needs ``missing_weights(rules.net) == ""``; raises DataError for damaged weights.
    """
    folder = weights_folder()
    features, heads = _network(rules.net, folder)
    try:
        return distance(_prepared(image, rules), _prepared(target, rules), rules.net, features, heads)
    except KeyError as lacking:
        raise DataError(f"the weights of '{rules.net}' in {folder} lack {lacking}", remedy=DOWNLOAD) from lacking


def distance(
    ours: Float[Tensor, "1 3 height width"],
    theirs: Float[Tensor, "1 3 height width"],
    net: Net,
    features: Mapping[str, Tensor],
    heads: list[Tensor],
) -> float:
    """The distance of two prepared images under given weights: heads over unit features, mean over pixels, summed."""
    layers = BACKBONES[net]
    total = 0.0
    for a, b, head in zip(layers(ours, features), layers(theirs, features), heads, strict=True):
        total += float(conv2d((_unit(a) - _unit(b)).square(), head).mean())
    return total


def _prepared(image: Float[Tensor, "height width 3"], rules: Lpips) -> Float[Tensor, "1 3 height width"]:
    value = image.cpu().float()
    if rules.input == "[-1, 1]":
        value = 2 * value - 1
    return ((value - torch.tensor(SHIFT)) / torch.tensor(SCALE)).permute(2, 0, 1)[None]


def _unit(value: Tensor) -> Tensor:
    return value / (value.square().sum(1, keepdim=True).sqrt() + UNIT_GUARD)


@cache
def _network(net: Net, folder: Path) -> tuple[dict[str, Tensor], list[Tensor]]:
    return read_weights(net, folder)
