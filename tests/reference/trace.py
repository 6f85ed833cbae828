"""Tracing through surfels as dense float64 PyTorch: every ray against every surfel, sorted, blended in a loop."""

import math

import torch
from torch import Tensor


def harmonics(d: Tensor) -> Tensor:
    """The 16 real spherical harmonics of 3DGS at directions d, by Cartesian formulas."""
    x, y, z = d[..., 0], d[..., 1], d[..., 2]
    c1 = math.sqrt(3 / (4 * math.pi))
    c2 = math.sqrt(15 / (4 * math.pi))
    c20 = math.sqrt(5 / (16 * math.pi))
    c33, c32 = math.sqrt(35 / (32 * math.pi)), math.sqrt(105 / (4 * math.pi))
    c31, c30 = math.sqrt(21 / (32 * math.pi)), math.sqrt(7 / (16 * math.pi))
    return torch.stack(
        [
            torch.full_like(x, math.sqrt(1 / (4 * math.pi))),
            -c1 * y, c1 * z, -c1 * x,
            c2 * x * y, -c2 * y * z, c20 * (2 * z**2 - x**2 - y**2), -c2 * x * z, c2 / 2 * (x**2 - y**2),
            -c33 * y * (3 * x**2 - y**2), c32 * x * y * z, -c31 * y * (4 * z**2 - x**2 - y**2),
            c30 * z * (2 * z**2 - 3 * x**2 - 3 * y**2), -c31 * x * (4 * z**2 - x**2 - y**2),
            c32 / 2 * z * (x**2 - y**2), -c33 * x * (x**2 - 3 * y**2),
        ],
        -1,
    )  # fmt: skip


def trace(
    centre: Tensor, axis_u: Tensor, axis_v: Tensor, normal: Tensor, opacity: Tensor, sh: Tensor, features: Tensor,
    origin: Tensor, direction: Tensor, t_min: Tensor, stop: float, back_from: float = math.inf,
) -> tuple[Tensor, Tensor, Tensor, Tensor]:  # fmt: skip
    """Radiance, transmittance, features and depth of every ray; from ``back_from`` on it meets black backs, too."""
    rows = []
    for o, d, nearest in zip(origin, direction, t_min, strict=True):
        facing = normal @ d
        front = facing < 0
        t = ((centre - o) * normal).sum(-1) / torch.where(facing != 0, facing, -1.0)
        point = o + t[:, None] * d - centre
        alpha = opacity * torch.exp(-0.5 * ((axis_u * point).sum(-1) ** 2 + (axis_v * point).sum(-1) ** 2))
        met = (front | ((facing > 0) & (t >= back_from))) & (t > nearest) & (alpha >= 1 / 255)
        alpha = alpha.clamp(max=0.99)
        colour = (torch.einsum("k,nkc->nc", harmonics(d)[: sh.shape[1]], sh) + 0.5).clamp(min=0)
        colour = torch.where(front[:, None], colour, 0.0)
        order = [i for i in torch.argsort(t, stable=True).tolist() if met[i]]
        left = torch.ones((), dtype=centre.dtype)
        radiance, blended, depth = torch.zeros(3).to(centre), torch.zeros(features.shape[1]).to(centre), 0 * left
        for i in order:
            weight = left * alpha[i]
            radiance, blended, depth = (
                radiance + weight * colour[i], blended + weight * features[i], depth + weight * t[i],
            )  # fmt: skip
            left = left * (1 - alpha[i])
            if left < stop:
                break
        rows.append((radiance, left, blended, depth))
    return tuple(torch.stack(column) for column in zip(*rows, strict=True))  # type: ignore[return-value]
