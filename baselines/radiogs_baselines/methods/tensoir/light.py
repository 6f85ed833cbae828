"""Distant light as a sum of spherical Gaussians: L(w) = sum_k mu_k exp(lambda_k (w.xi_k - 1))."""

import math
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import normalize

from radiogs_core.scene.light import EnvironmentMap, texel_directions, texel_solid_angles

from .settings import LightStart

GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))
"""Radians between consecutive directions of a spherical Fibonacci set."""

MAP_ROWS = 32
"""Rows of the environment map that a recovered light is converted to."""


@dataclass(frozen=True)
class SphericalGaussians:
    """Lobes of a distant light, world axes with Z up."""

    raw: Float[Tensor, "lobes 7"]
    """Axis xi (any length), sharpness lambda and linear RGB amplitude mu; lambda and mu are used without sign."""

    @property
    def sharpness(self) -> Float[Tensor, " lobes"]:
        """Sharpness lambda >= 0."""
        return self.raw[:, 3].abs()

    @property
    def amplitude(self) -> Float[Tensor, "lobes 3"]:
        """Amplitude mu >= 0: linear radiance along the axis."""
        return self.raw[:, 4:].abs()

    def radiance(self, direction: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Linear radiance from unit directions towards the light."""
        cosine = direction @ normalize(self.raw[:, :3], dim=-1).T
        return torch.exp(self.sharpness * (cosine - 1)) @ self.amplitude

    def integral(self) -> Float[Tensor, "3"]:
        """Integral over the sphere: sum of 2 pi mu (1 - exp(-2 lambda)) / lambda, or 4 pi mu for lambda = 0."""
        some = torch.where(self.sharpness > 0, self.sharpness, 1.0)
        width = torch.where(self.sharpness > 0, -torch.expm1(-2 * some) / some, 2.0)
        return 2 * torch.pi * (width @ self.amplitude)

    def environment(self, rows: int = MAP_ROWS) -> EnvironmentMap:
        """Environment map of the light, evaluated at the texel centres, without gradient."""
        raw = self.raw.detach()
        own = SphericalGaussians(raw)
        return EnvironmentMap(own.radiance(texel_directions(rows, 2 * rows, dtype=raw.dtype, device=raw.device)))


def light_start(lobes: int, start: LightStart, generator: torch.Generator) -> Float[Tensor, "lobes 7"]:
    """Initial white lobes of random sharpness and brightness, two along each direction of a spherical Fibonacci set."""
    device, pairs = generator.device, (lobes + 1) // 2
    drawn = torch.randn(lobes, 2, generator=generator, device=device)
    index = torch.arange(pairs, device=device)
    height, azimuth = 1 - (2 * index + 1) / pairs, index * GOLDEN_ANGLE
    sine = (1 - height.square()).sqrt()
    axis = torch.stack([sine * azimuth.cos(), sine * azimuth.sin(), height], -1).repeat(2, 1)[:lobes]
    sharpness = start.sharpness + start.spread * drawn[:, :1].abs()
    raw = torch.cat([axis, sharpness, drawn[:, 1:].abs().expand(-1, 3)], -1)
    mean = SphericalGaussians(raw).integral()[0] / (4 * torch.pi)
    return torch.cat([raw[:, :4], raw[:, 4:] * (start.mean / mean)], -1)


def stratified_directions(
    rows: int, generator: torch.Generator | None, like: Tensor
) -> tuple[Float[Tensor, "directions 3"], Float[Tensor, " directions"]]:
    """One direction in each cell of a lat-long map of ``rows`` rows, and the cells' solid angles in steradian.

    With ``generator`` directions are drawn uniformly in solid angle within the cell; without it they are its middle.
    The result has the dtype and device of ``like``.
    """
    columns = 2 * rows
    like_given: dict[str, Any] = {"dtype": like.dtype, "device": like.device}
    along, across = torch.full((2, rows, columns), 0.5, **like_given)
    if generator is not None:
        along, across = torch.rand(2, rows, columns, generator=generator, **like_given)
    edge = torch.cos(torch.arange(rows + 1, **like_given) * (torch.pi / rows))[:, None]
    height = edge[:-1] + (edge[1:] - edge[:-1]) * along
    azimuth = torch.pi - (torch.arange(columns, **like_given) + across) * (2 * torch.pi / columns)
    sine = (1 - height.square()).clamp(min=0).sqrt()
    direction = torch.stack([sine * azimuth.cos(), sine * azimuth.sin(), height], -1).flatten(0, 1)
    return direction, texel_solid_angles(rows, columns, **like_given).expand(rows, columns).flatten()
