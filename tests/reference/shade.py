"""The Monte-Carlo sum of Eq. 8 as dense float64 PyTorch, written from the formulas alone."""

import math

import torch
from torch import Tensor


def environment_radiance(environment: Tensor, direction: Tensor) -> Tensor:
    """Bilinear lat-long lookup, Z up, centre column towards +X, by explicit loops over the four neighbours."""
    height, width = environment.shape[:2]
    azimuth = torch.atan2(direction[..., 1], direction[..., 0])
    column = (0.5 - azimuth / (2 * math.pi)) * width - 0.5
    row = torch.acos(direction[..., 2].clamp(-1, 1)) / math.pi * height - 0.5
    row = row.clamp(0, height - 1)
    total = torch.zeros(*direction.shape[:-1], 3, dtype=environment.dtype)
    for down in (0, 1):
        for right in (0, 1):
            i, j = row.floor() + down, column.floor() + right
            share = (1 - (row - i).abs()) * (1 - (column - j).abs())
            total = total + share[..., None] * environment[i.long().clamp(0, height - 1), j.long() % width]
    return total


def shade(
    normal: Tensor,
    albedo: Tensor,
    roughness: Tensor,
    outgoing: Tensor,
    direction: Tensor,
    weight: Tensor,
    visibility: Tensor,
    indirect: Tensor,
    environment: Tensor,
) -> Tensor:
    """[surfels, views, 4, 3]: diffuse direct, diffuse indirect, specular direct, specular indirect."""
    n, v, w = normal[:, None, None], outgoing[:, :, None], direction[:, None]
    r = roughness[:, None, None]
    h = (v + w) / (v + w).norm(dim=-1, keepdim=True)
    nv, nl, nh, vh = ((a * b).sum(-1) for a, b in ((n, v), (n, w), (n, h), (v, h)))
    a2 = r**4
    sine2 = (torch.linalg.cross(n.expand_as(h), h)).square().sum(-1)
    d = a2 / (math.pi * (a2 * nh**2 + sine2) ** 2)
    f = 0.04 + 0.96 * 2 ** ((-5.55473 * vh - 6.98316) * vh)
    k = (r + 1) ** 2 / 8
    g = nv / (nv * (1 - k) + k) * nl / (nl * (1 - k) + k)
    above = (nv > 0) & (nl > 0)
    specular = torch.where(above, d * f * g / (4 * torch.where(above, nv * nl, 1.0)), 0.0)
    diffuse = torch.where(above, 1.0, 0.0)[..., None] * albedo[:, None, None] / math.pi
    cosine = (weight[:, None] * nl.clamp(min=0))[..., None]
    direct = (visibility[..., None] * environment_radiance(environment, direction))[:, None]
    parts = [diffuse * direct, diffuse * indirect[:, None], specular[..., None] * direct]
    parts.append(specular[..., None] * indirect[:, None])
    return torch.stack([(cosine * part).sum(2) for part in parts], 2)
