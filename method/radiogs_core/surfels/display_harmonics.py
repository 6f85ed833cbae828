"""Spherical harmonics of a surfel's display colour, as splat viewers expect them."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from ..kernels.surfel.harmonics import harmonic_sum
from ..scene.colour import srgb_encode
from .harmonics import COEFFICIENTS

DIRECTIONS = 256
"""Directions over the sphere at which harmonics are evaluated for the least-squares fit."""

AT_A_TIME = 1 << 13
"""Surfels whose harmonics are fitted together, to bound the memory."""


def display_harmonics(sh: Float[Tensor, "surfels 16 3"]) -> Float[Tensor, "surfels 16 3"]:
    """Harmonics whose value plus 1/2 is the display sRGB of ``sh``'s linear radiance, clipped at 1; CPU, float32.

    The sRGB curve of harmonics is not a sum of harmonics, so the result is a least-squares fit over the sphere. The fit
    is exact for a surfel that looks the same from all directions.
    """
    basis = basis_along(spread_directions(DIRECTIONS))
    fit = torch.linalg.pinv(basis)
    shown = [
        torch.einsum("cd,ndk->nck", fit, srgb_encode((basis @ some.double() + 0.5).clamp(0, 1)) - 0.5)
        for some in sh.detach().cpu().split(AT_A_TIME)
    ]
    return torch.cat(shown).float()


def spread_directions(count: int) -> Float[Tensor, "directions 3"]:
    """Unit vectors evenly over the sphere (a Fibonacci lattice), float64."""
    index = torch.arange(count, dtype=torch.float64)
    height = 1 - (2 * index + 1) / count
    turn = index * math.pi * (3 - math.sqrt(5))
    side = (1 - height.square()).sqrt()
    return torch.stack([side * turn.cos(), side * turn.sin(), height], -1)


def basis_along(directions: Float[Tensor, "directions 3"]) -> Float[Tensor, "directions 16"]:
    """The value of each harmonic along unit directions, float64."""
    unit = torch.eye(COEFFICIENTS, dtype=torch.float64)[..., None].expand(-1, -1, 3).contiguous()
    return harmonic_sum(unit, directions.expand(COEFFICIENTS, -1, -1).contiguous())[..., 0].T
