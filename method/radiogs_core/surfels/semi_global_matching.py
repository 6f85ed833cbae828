"""Semi-global matching (Hirschmueller 2008): the costs of neighbouring pixels, brought together so that depth rarely
jumps, and the depth of the least cost."""

import torch
from jaxtyping import Bool, Float, Shaped
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
        lines, inside = _both_ways(cost.movedim(axis + 1, 0)), _both_ways(covered.movedim(axis, 0))
        forwards, backwards = _along(lines, inside, step, jump).chunk(2, -1)
        total += forwards.movedim(0, axis + 1)
        total += backwards.flip(0).movedim(0, axis + 1)
    return total


def _both_ways(forwards: Shaped[Tensor, "length *planes lines"]) -> Shaped[Tensor, "length *planes both"]:
    return torch.cat([forwards, forwards.flip(0)], -1)


def _along(
    cost: Float[Tensor, "length planes lines"], covered: Bool[Tensor, "length lines"], step: float, jump: float
) -> Float[Tensor, "length planes lines"]:
    length, planes, lines = cost.shape
    walled = cost.new_full((length, planes + 2, lines), torch.inf)
    paths = walled[:, 1:-1]
    paths[0] = cost[0]
    for place in range(1, length):
        before, sides = paths[place - 1], walled[place - 1]
        least = before.amin(0, keepdim=True)
        beside = torch.minimum(sides[2:], sides[:-2]).add_(step)
        reached = torch.minimum(beside, before).minimum(least + jump).sub_(least)
        torch.add(cost[place], torch.where(covered[place - 1], reached, 0.0), out=paths[place])
    return paths


def lowest(
    cost: Float[Tensor, "planes rows columns"], planes: Float[Tensor, " planes"]
) -> Float[Tensor, "rows columns"]:
    """Depth of the least cost, between planes by the parabola through it and its two neighbours."""
    best = cost.argmin(0).clamp(1, len(planes) - 2)
    before, here, after = (cost.gather(0, (best + shift)[None])[0] for shift in (-1, 0, 1))
    bend = before + after - 2 * here
    shift = torch.where(bend > 0, (before - after) / (2 * torch.where(bend > 0, bend, 1.0)), 0.0).clamp(-0.5, 0.5)
    return planes[best] + shift * (planes[1] - planes[0])
