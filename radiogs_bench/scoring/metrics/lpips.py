"""LPIPS v0.1 (Zhang et al. 2018), only with the published weights, on torchvision's convolutional networks."""

from collections.abc import Callable, Iterator, Mapping
from functools import cache

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import conv2d, max_pool2d, relu

from radiogs_core.errors import DataError

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


_network = cache(read_weights)

Weights = Mapping[str, Tensor]
Layers = Iterator[Float[Tensor, "1 channels rows columns"]]

ALEX_LAYERS = ((0, 4, 2), (3, 1, 2), (6, 1, 1), (8, 1, 1), (10, 1, 1))
"""Index, stride and padding of AlexNet's convolutions; a 3 x 3 pool of stride 2 precedes convolutions 3 and 6."""

ALEX_POOL_BEFORE = (3, 6)

VGG_BLOCKS = ((0, 2), (5, 7), (10, 12, 14), (17, 19, 21), (24, 26, 28))
"""Indices of VGG16's 3 x 3 convolutions; a 2 x 2 pool lies between blocks, and each block's last layer is tapped."""

SQUEEZE_BLOCKS = ((3, 4), (6, 7), (9,), (10,), (11,), (12,))
"""Indices of SqueezeNet's fire modules; the last of each block is tapped."""

SQUEEZE_POOL_BEFORE = (3, 6, 9)


def alex_layers(image: Float[Tensor, "1 3 height width"], weights: Weights) -> Layers:
    """AlexNet's five activations."""
    value = image
    for index, stride, padding in ALEX_LAYERS:
        if index in ALEX_POOL_BEFORE:
            value = max_pool2d(value, 3, 2)
        value = _convolved(value, weights, f"features.{index}", stride, padding)
        yield value


def vgg_layers(image: Float[Tensor, "1 3 height width"], weights: Weights) -> Layers:
    """VGG16's activations relu1_2, relu2_2, relu3_3, relu4_3, relu5_3."""
    value = image
    for block, indices in enumerate(VGG_BLOCKS):
        if block > 0:
            value = max_pool2d(value, 2, 2)
        for index in indices:
            value = _convolved(value, weights, f"features.{index}", padding=1)
        yield value


def squeeze_layers(image: Float[Tensor, "1 3 height width"], weights: Weights) -> Layers:
    """SqueezeNet 1.1's seven activations; its pools keep a last partial window (ceil_mode)."""
    value = _convolved(image, weights, "features.0", stride=2)
    yield value
    for indices in SQUEEZE_BLOCKS:
        if indices[0] in SQUEEZE_POOL_BEFORE:
            value = max_pool2d(value, 3, 2, ceil_mode=True)
        for index in indices:
            value = _fire(value, weights, f"features.{index}")
        yield value


BACKBONES: Mapping[Net, Callable[[Tensor, Weights], Layers]] = {
    "alex": alex_layers,
    "vgg": vgg_layers,
    "squeeze": squeeze_layers,
}


def _convolved(value: Tensor, weights: Weights, name: str, stride: int = 1, padding: int = 0) -> Tensor:
    return relu(conv2d(value, weights[f"{name}.weight"], weights[f"{name}.bias"], stride, padding))


def _fire(value: Tensor, weights: Weights, name: str) -> Tensor:
    squeezed = _convolved(value, weights, f"{name}.squeeze")
    narrow = _convolved(squeezed, weights, f"{name}.expand1x1")
    wide = _convolved(squeezed, weights, f"{name}.expand3x3", padding=1)
    return torch.cat([narrow, wide], 1)
