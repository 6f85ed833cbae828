"""A tube along a trefoil knot by formula: points, normals, a closed mesh, and what lies inside.

The knot's curve winds twice around the axis of a torus and three times around its tube (world units, t in radian):

    c(t) = centre + ((ring + swing cos 3t) cos 2t, (ring + swing cos 3t) sin 2t, swing sin 3t)

The torus' own normal N(t) is perpendicular to the curve and has its period. With the curve's direction T and B = T x N,
the tube is c + radius (cos s N + sin s B): a grid over (t, s) that closes on itself without a twist.
"""

import math

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from .solids import Knot

AROUND_AXIS, AROUND_TUBE = 2, 3

CURVE_POINTS = 2048
"""On the curve, for distances to it: too large by less than the square of half their spacing over twice the radius."""

BLOCK = 4096
"""Points whose distances to the curve are held at once."""


def curve(knot: Knot, t: Float[Tensor, " n"]) -> Float[Tensor, "n 3"]:
    """Middle of the tube."""
    around, beside = AROUND_AXIS * t, AROUND_TUBE * t
    reach = knot.ring + knot.swing * beside.cos()
    offset = torch.stack([reach * around.cos(), reach * around.sin(), knot.swing * beside.sin()], -1)
    return t.new_tensor(knot.centre) + offset


def normals(knot: Knot, t: Float[Tensor, " n"], s: Float[Tensor, " n"]) -> Float[Tensor, "n 3"]:
    """Outward unit normals of the tube."""
    around, beside = AROUND_AXIS * t, AROUND_TUBE * t
    out = torch.stack([around.cos(), around.sin(), torch.zeros_like(t)], -1)
    ahead = torch.stack([-around.sin(), around.cos(), torch.zeros_like(t)], -1)
    upwards = torch.tensor([0.0, 0.0, 1.0], dtype=t.dtype)
    across = beside.cos()[:, None] * out + beside.sin()[:, None] * upwards
    turning = beside.cos()[:, None] * upwards - beside.sin()[:, None] * out
    reach = (knot.ring + knot.swing * beside.cos())[:, None]
    along = torch.nn.functional.normalize(AROUND_AXIS * reach * ahead + AROUND_TUBE * knot.swing * turning, dim=-1)
    return s.cos()[:, None] * across + s.sin()[:, None] * torch.linalg.cross(along, across)


def points(knot: Knot, t: Float[Tensor, " n"], s: Float[Tensor, " n"]) -> Float[Tensor, "n 3"]:
    """On the tube's surface."""
    return curve(knot, t) + knot.radius * normals(knot, t, s)


def tangents(
    knot: Knot, t: Float[Tensor, " n"], s: Float[Tensor, " n"]
) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"]]:
    """Derivatives of ``points`` by t and by s; their cross product points inwards."""
    one, none = torch.ones_like(t), torch.zeros_like(t)
    by_t, by_s = (torch.func.jvp(lambda *at: points(knot, *at), (t, s), way)[1] for way in ((one, none), (none, one)))
    return by_t, by_s


def grid(along: int, around: int) -> tuple[Float[Tensor, " cells"], Float[Tensor, " cells"]]:
    """Parameters t and s at the middles of the cells of a grid over the tube, t slowest. Float64."""
    t, s = (2 * math.pi * (torch.arange(count, dtype=torch.float64) + 0.5) / count for count in (along, around))
    return t.repeat_interleave(around), s.repeat(along)


def mesh(knot: Knot, along: int, around: int) -> tuple[Float[Tensor, "vertices 3"], Int[Tensor, "triangles 3"]]:
    """The tube as a closed mesh with outward triangles, vertices on it. Float64."""
    row = torch.arange(along)[:, None] * around
    next_row = row.roll(-1, 0)
    column = torch.arange(around)
    next_column = column.roll(-1)
    corners = [(one + other).flatten() for one in (row, next_row) for other in (column, next_column)]
    near, beside, far, across = corners
    triangles = torch.cat([torch.stack([near, beside, far], -1), torch.stack([far, beside, across], -1)])
    return points(knot, *grid(along, around)), triangles


def inside(knot: Knot, at: Float[Tensor, "points 3"], margin: float) -> Bool[Tensor, " points"]:
    """Which points lie in the tube or nearer than ``margin`` to it."""
    reach = knot.radius + margin
    middle = curve(knot, 2 * math.pi * torch.arange(CURVE_POINTS, dtype=at.dtype) / CURVE_POINTS)
    found = ((at > middle.amin(0) - reach) & (at < middle.amax(0) + reach)).all(-1)
    near = [torch.cdist(block, middle).amin(-1) < reach for block in at[found].split(BLOCK)]
    found[found.clone()] = torch.cat(near) if near else found.new_zeros(0)
    return found
