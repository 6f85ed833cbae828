"""Surfels as a camera draws them, surfel by surfel from the matrices of the formulas, in dense float64 PyTorch."""

import math

import torch
from torch import Tensor


def widened(
    eye: Tensor, forward: Tensor, focal: float, centre: Tensor, frame: Tensor, scale: Tensor, opacity: Tensor
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Axes, normal and opacity of surfels whose covariance has the footprint of a pixel added; ``focal`` in pixels."""
    axes_u, axes_v, normals, opacities = [], [], [], []
    for c, m, s, o in zip(centre, frame, scale, opacity, strict=True):
        with torch.no_grad():
            towards = (eye - c) / (eye - c).norm()
            tilt, cosine = m[:, :2].mT @ towards, float(m[:, 2] @ towards)
            variance = (float((c - eye) @ forward) / focal) ** 2 / 12
            footprint = variance * (torch.eye(2).double() + torch.outer(tilt, tilt) / max(cosine**2, 0.05**2))
        covariance = torch.diag(s.square()) + footprint
        to_plane = torch.linalg.inv(torch.linalg.cholesky(covariance))
        axes = to_plane @ m[:, :2].mT
        axes_u.append(axes[0])
        axes_v.append(axes[1])
        normals.append(m[:, 2])
        opacities.append(o * s.prod() / torch.linalg.det(covariance).sqrt())
    return torch.stack(axes_u), torch.stack(axes_v), torch.stack(normals), torch.stack(opacities)


def support_squared(opacity: float) -> float:
    """The squared radius at which a surfel's alpha is one grey level."""
    return 2 * math.log(255 * opacity) if opacity > 1 / 255 else 0.0
