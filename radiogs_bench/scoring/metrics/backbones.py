"""The convolutional parts of torchvision's AlexNet, VGG16 and SqueezeNet 1.1, up to where LPIPS taps them."""

from collections.abc import Callable, Iterator, Mapping

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import conv2d, max_pool2d, relu

from .conventions import Net

Weights = Mapping[str, Tensor]
Layers = Iterator[Float[Tensor, "1 channels rows columns"]]

ALEX_LAYERS = ((0, 4, 2), (3, 1, 2), (6, 1, 1), (8, 1, 1), (10, 1, 1))
"""Index, stride and padding of AlexNet's convolutions; a 3 x 3 pool of stride 2 stands before 3 and 6."""

ALEX_POOL_BEFORE = (3, 6)

VGG_BLOCKS = ((0, 2), (5, 7), (10, 12, 14), (17, 19, 21), (24, 26, 28))
"""Indices of VGG16's 3 x 3 convolutions; a 2 x 2 pool stands between blocks, and the last of each block is tapped."""

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
