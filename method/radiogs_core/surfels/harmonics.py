"""Directional radiance of a surfel: real spherical harmonics up to degree 3, in the basis and signs of 3DGS."""

import math
from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from ..kernels.surfel.harmonics import harmonic_sum

COEFFICIENTS = 16
"""Coefficients of degrees 0 to 3."""

CONSTANT_BASIS = 0.28209479177387814
"""The degree-0 basis function, 1 / (2 sqrt(pi))."""

DIRECTIONS = 256
"""Directions over the sphere at which harmonics are evaluated for the least-squares fit."""

AT_A_TIME = 1 << 13
"""Surfels whose harmonics are fitted together, to bound the memory."""


def surfel_radiance(
    sh: Float[Tensor, "surfels coefficients 3"], outgoing: Float[Tensor, "surfels *views 3"]
) -> Float[Tensor, "surfels *views 3"]:
    """Radiance L_G that each surfel sends along unit ``outgoing`` directions (away from the surface), linear RGB.

    L_G = max(0, SH(-outgoing) + 1/2): 3DGS evaluates its harmonics along the direction of travel.
    """
    return unclamped_radiance(sh, outgoing).clamp(min=0)


def unclamped_radiance(
    sh: Float[Tensor, "surfels coefficients 3"], outgoing: Float[Tensor, "surfels *views 3"]
) -> Float[Tensor, "surfels *views 3"]:
    """``surfel_radiance`` without the clamp at zero, so that negative values keep a gradient."""
    views = outgoing.reshape(len(sh), outgoing.shape[1:-1].numel(), 3)
    return harmonic_sum(sh, -views).view(outgoing.shape) + 0.5


def refitted_harmonics(
    sh: Float[Tensor, "surfels 16 3"], curve: Callable[[Tensor], Tensor]
) -> Float[Tensor, "surfels 16 3"]:
    """Harmonics whose value plus 1/2 is ``curve`` of ``sh``'s value plus 1/2, clipped to [0, 1]; CPU, float32.

    A curve of harmonics is not a sum of harmonics, so the result is a least-squares fit over the sphere. The fit is
    exact for a surfel that looks the same from all directions.
    """
    basis = basis_along(spread_directions(DIRECTIONS))
    fit = torch.linalg.pinv(basis)
    shown = [
        torch.einsum("cd,ndk->nck", fit, curve((basis @ some.double() + 0.5).clamp(0, 1)) - 0.5)
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
