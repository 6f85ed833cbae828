"""Semi-global matching (Hirschmueller 2008): the costs of neighbouring pixels, brought together so that depth rarely
jumps, and the depth of the least cost."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor


def aggregated(
    cost: Float[Tensor, "planes rows columns"], covered: Bool[Tensor, "rows columns"], step: float, jump: float
) -> Float[Tensor, "planes rows columns"]:
    """Semi-global costs: for each pixel and plane, the cheapest path from four sides that ends there, summed.

    A path pays the cost of each pixel, ``step`` where it changes by one plane and ``jump`` where it changes by more. It
    begins anew behind pixels that are not covered. Costs along a path are kept small by taking off the least so far.
    """
    total = torch.zeros_like(cost)
    for axis in (0, 1):
        for backwards in (False, True):
            along = (cost.movedim(axis + 1, 0), covered.movedim(axis, 0))
            lines, inside = (each.flip(0) for each in along) if backwards else along
            path = _along(lines, inside, step, jump)
            total += (path.flip(0) if backwards else path).movedim(0, axis + 1)
    return total


def _along(
    cost: Float[Tensor, "length planes lines"], covered: Bool[Tensor, "length lines"], step: float, jump: float
) -> Float[Tensor, "length planes lines"]:
    paths, wall = [cost[0]], torch.full_like(cost[0, :1], torch.inf)
    for here, inside in zip(cost[1:], covered[:-1], strict=True):
        before = paths[-1]
        least = before.min(0, keepdim=True).values
        beside = torch.minimum(torch.cat([before[1:], wall]), torch.cat([wall, before[:-1]])) + step
        reached = torch.minimum(torch.minimum(before, beside), least + jump) - least
        paths.append(here + torch.where(inside, reached, 0.0))
    return torch.stack(paths)


def lowest(
    cost: Float[Tensor, "planes rows columns"], planes: Float[Tensor, " planes"]
) -> Float[Tensor, "rows columns"]:
    """Depth of the least cost, between planes by the parabola through it and its two neighbours."""
    best = cost.argmin(0).clamp(1, len(planes) - 2)
    before, here, after = (cost.gather(0, (best + shift)[None])[0] for shift in (-1, 0, 1))
    bend = before + after - 2 * here
    shift = torch.where(bend > 0, (before - after) / (2 * torch.where(bend > 0, bend, 1.0)), 0.0).clamp(-0.5, 0.5)
    return planes[best] + shift * (planes[1] - planes[0])
