"""A tube along a trefoil knot by formula: points, normals, a closed mesh, and a test for points inside.

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
"""Number of the curve's points for distances to it: they are too large by less than (spacing / 2)^2 / (2 radius)."""

BLOCK = 4096
"""Points whose distances to the curve are held at once."""


def curve(knot: Knot, t: Float[Tensor, " n"]) -> Float[Tensor, "n 3"]:
    """Middle of the tube."""
    beside, out, _, upwards = _axes(t)
    offset = (knot.ring + knot.swing * beside.cos())[:, None] * out + knot.swing * beside.sin()[:, None] * upwards
    return t.new_tensor(knot.centre) + offset


def frames(knot: Knot, t: Float[Tensor, " n"], s: Float[Tensor, " n"]) -> Float[Tensor, "n 3 3"]:
    """Orthonormal, right-handed frames of the tube; columns: around it, along its curve, outwards."""
    beside, out, _, upwards = _axes(t)
    along = torch.nn.functional.normalize(_derivatives(knot, t)[0], dim=-1)
    first = beside.cos()[:, None] * out + beside.sin()[:, None] * upwards
    second = torch.linalg.cross(along, first)
    cosine, sine = s.cos()[:, None], s.sin()[:, None]
    return torch.stack([cosine * second - sine * first, along, cosine * first + sine * second], -1)


def points(knot: Knot, t: Float[Tensor, " n"], s: Float[Tensor, " n"]) -> Float[Tensor, "n 3"]:
    """On the tube's surface."""
    return curve(knot, t) + knot.radius * frames(knot, t, s)[..., 2]


def stretch(knot: Knot, t: Float[Tensor, " n"], s: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
    """World units along the curve's direction per radian of t, on the tube: |c'| - radius n.c'' / |c'|.

    Times the radius this is the tube's area per unit of t and s; it is smaller on the inside of a bend.
    """
    first, second = _derivatives(knot, t)
    speed = first.norm(dim=-1)
    return speed - knot.radius * (frames(knot, t, s)[..., 2] * second).sum(-1) / speed


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


def _axes(
    t: Float[Tensor, " n"],
) -> tuple[Float[Tensor, " n"], Float[Tensor, "n 3"], Float[Tensor, "n 3"], Float[Tensor, " 3"]]:
    """Angle in the torus' tube; unit directions away from the axis and around it; upwards."""
    around, none = AROUND_AXIS * t, torch.zeros_like(t)
    out = torch.stack([around.cos(), around.sin(), none], -1)
    ahead = torch.stack([-around.sin(), around.cos(), none], -1)
    return AROUND_TUBE * t, out, ahead, t.new_tensor([0.0, 0.0, 1.0])


def _derivatives(knot: Knot, t: Float[Tensor, " n"]) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"]]:
    """First and second derivative of the curve by t."""
    beside, out, ahead, upwards = _axes(t)
    cosine, sine = knot.swing * beside.cos()[:, None], knot.swing * beside.sin()[:, None]
    reach = knot.ring + cosine
    first = AROUND_TUBE * (cosine * upwards - sine * out) + AROUND_AXIS * reach * ahead
    inwards = AROUND_TUBE**2 * cosine + AROUND_AXIS**2 * reach
    second = -inwards * out - AROUND_TUBE**2 * sine * upwards - 2 * AROUND_TUBE * AROUND_AXIS * sine * ahead
    return first, second
