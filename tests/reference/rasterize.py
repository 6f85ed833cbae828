"""Rasterization as dense float64 PyTorch: every pixel against every surfel, ordered by depth of the centres."""

import torch
from torch import Tensor


def rasterize(
    axes: Tensor, eye: Tensor, pixels: Tensor, centre: Tensor, axis_u: Tensor, axis_v: Tensor, normal: Tensor,
    opacity: Tensor, features: Tensor, depth_unit: float,
) -> tuple[Tensor, Tensor, Tensor, Tensor]:  # fmt: skip
    """Features, alpha, depth, distortion of each pixel; ``pixels`` are world rays of unit depth."""
    order = torch.argsort((centre - eye) @ axes[:, 2], stable=True)
    results = []
    for ray in pixels:
        left = torch.ones((), dtype=centre.dtype)
        weights, depths, members = [], [], []
        for i in order.tolist():
            facing = normal[i] @ ray
            if not facing < 0:
                continue
            t = (normal[i] @ (centre[i] - eye)) / facing
            offset = eye + t * ray - centre[i]
            alpha = opacity[i] * torch.exp(-0.5 * ((axis_u[i] @ offset) ** 2 + (axis_v[i] @ offset) ** 2))
            if not (t > 0 and alpha >= 1 / 255):
                continue
            alpha = alpha.clamp(max=0.99)
            if left * (1 - alpha) < 1e-4:
                break
            weights.append(left * alpha)
            depths.append(t)
            members.append(i)
            left = left * (1 - alpha)
        if not weights:
            results.append((torch.zeros_like(features[0]), *[torch.zeros((), dtype=centre.dtype)] * 3))
            continue
        weight, depth = torch.stack(weights), torch.stack(depths)
        gaps = ((depth[:, None] - depth[None, :]) / depth_unit) ** 2
        distortion = 0.5 * (weight[:, None] * weight[None, :] * gaps).sum()
        results.append((weight @ features[members], weight.sum(), weight @ depth, distortion))
    return tuple(torch.stack(column) for column in zip(*results, strict=True))  # type: ignore[return-value]
