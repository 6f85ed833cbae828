"""The small networks that read features: two hidden layers, inputs beside sines and cosines of them."""

import math
from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import linear

FREQUENCIES = 2
"""Sines and cosines of 1 and 2 times each input."""

LAYERS = 3

ENCODED = 1 + 2 * FREQUENCIES
"""Values of each input."""


def encoded(values: Float[Tensor, "points inputs"]) -> Float[Tensor, "points encoded"]:
    """The values, and sines and cosines of 1, 2, ... times them."""
    octaves = [values * 2.0**octave for octave in range(FREQUENCIES)]
    return torch.cat([values, *(wave for each in octaves for wave in (each.sin(), each.cos()))], -1)


def network_start(
    name: str, inputs: int, hidden: int, outputs: int, generator: torch.Generator
) -> dict[str, Float[Tensor, "..."]]:
    """Weights uniform in +-1 / sqrt(inputs of the layer), biases zero, on the generator's device."""
    widths = [inputs * ENCODED, hidden, hidden, outputs]
    found: dict[str, Tensor] = {}
    for layer in range(LAYERS):
        bound = 1 / math.sqrt(widths[layer])
        drawn = torch.rand(widths[layer + 1], widths[layer], generator=generator, device=generator.device)
        found[f"{name}_weight_{layer}"] = (2 * drawn - 1) * bound
        found[f"{name}_bias_{layer}"] = torch.zeros(widths[layer + 1], device=generator.device)
    return found


def answer(
    name: str, parameters: Mapping[str, Tensor], inputs: Float[Tensor, "points inputs"]
) -> Float[Tensor, "points outputs"]:
    """The network's outputs before any activation of the last layer."""
    values = encoded(inputs)
    for layer in range(LAYERS):
        values = linear(values, parameters[f"{name}_weight_{layer}"], parameters[f"{name}_bias_{layer}"])
        values = values.relu() if layer < LAYERS - 1 else values
    return values
