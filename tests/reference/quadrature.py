"""Deterministic sums over directions, in float64, for tests that must not sample."""

import math

import torch
from torch import Tensor


def lobe_quadrature(view_cosine: float, roughness: float, steps: int = 160) -> tuple[Tensor, Tensor, Tensor]:
    """A view direction [3], light directions [n, 3] about +Z and their solid angles, dense where a lobe is.

    Half-vectors on a grid of azimuth and of log tan^2(theta) around alpha^2; a mirrored direction covers
    d(wi) = 4 |wo.h| d(h) of solid angle.
    """
    wo = torch.tensor([math.sqrt(1 - view_cosine**2), 0.0, view_cosine], dtype=torch.float64)
    step = 24 / (4 * steps)
    tangent_squared = torch.exp((torch.arange(4 * steps, dtype=torch.float64) + 0.5) * step - 14) * roughness**4
    azimuth = (torch.arange(steps, dtype=torch.float64) + 0.5) * (2 * math.pi / steps)
    tangent_squared, azimuth = torch.meshgrid(tangent_squared, azimuth, indexing="ij")
    cosine = (1 + tangent_squared).rsqrt()
    sine = (1 - cosine**2).clamp(min=0).sqrt()
    half = torch.stack([sine * azimuth.cos(), sine * azimuth.sin(), cosine], -1).reshape(-1, 3)
    # d(h) = sin d(theta) d(phi), and sin d(theta) = cos^3 d(tan^2) / 2.
    covered = (cosine**3 * tangent_squared * step / 2 * (2 * math.pi / steps)).reshape(-1)
    along = half @ wo
    wi = 2 * along[:, None] * half - wo
    return wo, wi, torch.where(along > 0, 4 * along * covered, 0.0)


def sphere_quadrature(rows: int = 128) -> tuple[Tensor, Tensor]:
    """Directions [n, 3] and solid angles [n] of a grid that is uniform in azimuth and in polar angle."""
    polar = (torch.arange(rows, dtype=torch.float64) + 0.5) * (math.pi / rows)
    azimuth = (torch.arange(2 * rows, dtype=torch.float64) + 0.5) * (math.pi / rows)
    polar, azimuth = torch.meshgrid(polar, azimuth, indexing="ij")
    direction = torch.stack([polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos()], -1)
    # The integral of sin over a cell of height d is 2 sin(d / 2) sin(middle).
    covered = 2 * math.sin(math.pi / rows / 2) * polar.sin() * (math.pi / rows)
    return direction.reshape(-1, 3), covered.reshape(-1)
