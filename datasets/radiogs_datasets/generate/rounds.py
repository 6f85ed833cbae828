"""Solids of revolution and reliefs by formula: closed meshes, samples of their surfaces, and tests for points inside.

Both are rings around a vertical axis between two poles. A profile in the half-plane of (distance from the axis, height)
is a uniform cubic B-spline c(t) whose control points are mirrored at the axis, for t from -1/2 to their number less
1/2; its outward normal is (z', -r') / |c'|. A relief is centre + r(d) d for unit directions d. With g the gradient of r
on the sphere of directions, r d - g is normal to it; a unit step along g becomes one of sqrt(r^2 + |g|^2) on the
surface, and one across g of r. Everything is float64.
"""

import math

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from radiogs_core.transport.sampling import sphere_directions, tangent_frame

from .patterns import waves
from .solids import Relief, Turned

ROWS_PER_POINT, COLUMNS = 48, 192
"""Mesh of a solid of revolution: rows for each control point of its profile, and columns around it."""

RELIEF_MESH = (640, 1024)
"""Rows and columns of the mesh of a relief: several dozen for each of its shortest ripples."""

PROFILE_PLACES = 4096
"""Number of points along a profile for its length and for distances to it."""

BLOCK = 4096
"""Points whose distances to a profile are held at once."""

Cells = tuple[Float[Tensor, "cells 3"], Float[Tensor, "cells 3 3"], Float[Tensor, "cells 2"]]
"""Centres, frames and sizes of the cells of a surface, as ``SurfaceSamples`` has them."""


def mesh(solid: Turned | Relief) -> tuple[Float[Tensor, "vertices 3"], Int[Tensor, "triangles 3"]]:
    """The surface as a closed mesh with outward triangles, vertices on it: the lower pole, rings, the upper pole."""
    rows, columns = RELIEF_MESH if isinstance(solid, Relief) else (ROWS_PER_POINT * len(solid.profile), COLUMNS)
    share = torch.arange(rows + 1, dtype=torch.float64) / rows
    azimuth = 2 * math.pi * torch.arange(columns, dtype=torch.float64) / columns
    row, around = share.repeat_interleave(columns), azimuth.repeat(rows + 1)
    if isinstance(solid, Relief):
        polar = math.pi * row
        direction = torch.stack([polar.sin() * around.cos(), polar.sin() * around.sin(), -polar.cos()], -1)
        points = direction * radii(solid, direction)[0][:, None]
    else:
        place = profile(solid, row * len(solid.profile) - 0.5)[0]
        points = torch.stack([place[:, 0] * around.cos(), place[:, 0] * around.sin(), place[:, 1]], -1)
    kept = points[columns - 1 : len(points) - columns + 1] + points.new_tensor(solid.centre)
    return kept, _ring_triangles(rows, columns)


def _ring_triangles(rows: int, columns: int) -> Int[Tensor, "triangles 3"]:
    """Triangles over a pole, ``rows`` - 1 rings of ``columns`` vertices, and a second pole; triangles face outwards."""
    last = (rows - 1) * columns + 1
    ring = torch.arange(rows - 1)[:, None] * columns + 1 + torch.arange(columns)
    turned = ring.roll(-1, 1)
    near, beside, far, across = (each.flatten() for each in (ring[:-1], turned[:-1], ring[1:], turned[1:]))
    below, above = torch.zeros(columns, dtype=torch.long), torch.full((columns,), last)
    parts = (
        (below, turned[0], ring[0]), (near, beside, far), (far, beside, across), (ring[-1], turned[-1], above),
    )  # fmt: skip
    return torch.cat([torch.stack(part, -1) for part in parts])


def cells(solid: Turned | Relief, spacing: float) -> Cells:
    """Samples of the whole surface, each standing for a cell of at most ``spacing`` (world units) a side."""
    if isinstance(solid, Turned):
        return _turned_cells(solid, spacing)
    count = math.ceil(4 * math.pi * solid.radius**2 / spacing**2)
    while True:
        found = _relief_cells(solid, count)
        largest = float(found[2].max())
        if largest <= spacing:
            return found
        count = math.ceil(count * (largest / spacing) ** 2)


def inside(solid: Turned | Relief, at: Float[Tensor, "points 3"], margin: float) -> Bool[Tensor, " points"]:
    """Which points lie in the solid or nearer than ``margin`` (world units) to it; of a relief to first order."""
    offset = at - at.new_tensor(solid.centre)
    if isinstance(solid, Relief):
        distance = offset.norm(dim=-1)
        direction = torch.where(distance[:, None] > 0, offset / distance[:, None], at.new_tensor([0.0, 0.0, 1.0]))
        radius, gradient = radii(solid, direction)
        return (distance - radius) / (1 + (gradient / radius[:, None]).square().sum(-1)).sqrt() < margin
    t = torch.linspace(-0.5, len(solid.profile) - 0.5, PROFILE_PLACES, dtype=torch.float64)
    curve, _, outwards = profile(solid, t)
    flat = torch.stack([offset[:, :2].norm(dim=-1), offset[:, 2]], -1)
    found = ((flat > curve.amin(0) - margin) & (flat < curve.amax(0) + margin)).all(-1)
    near = [_beyond(curve, outwards, block) < margin for block in flat[found].split(BLOCK)]
    found[found.clone()] = torch.cat(near) if near else found.new_zeros(0)
    return found


def _beyond(
    curve: Float[Tensor, "n 2"], outwards: Float[Tensor, "n 2"], at: Float[Tensor, "points 2"]
) -> Float[Tensor, " points"]:
    """Distance of points from a profile, negative inside."""
    distance, place = torch.cdist(at, curve).min(-1)
    return torch.where(((at - curve[place]) * outwards[place]).sum(-1) < 0, -distance, distance)


def profile(
    solid: Turned, t: Float[Tensor, " n"]
) -> tuple[Float[Tensor, "n 2"], Float[Tensor, "n 2"], Float[Tensor, "n 2"]]:
    """Points c(t) (distance from the axis, height above the centre), derivatives by t, and unit outward normals."""
    points = t.new_tensor(solid.profile)
    mirror = t.new_tensor([-1.0, 1.0])
    points = torch.cat([points[:2].flip(0) * mirror, points, points[-2:].flip(0) * mirror])
    first = t.floor().clamp(-1, len(solid.profile) - 1)
    u = (t - first)[:, None]
    four = points[(first.long() + 1) + torch.arange(4)[:, None]]
    weights = ((1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3)
    slopes = (-((1 - u) ** 2), 3 * u**2 - 4 * u, -3 * u**2 + 2 * u + 1, u**2)
    place = (torch.stack(weights) * four).sum(0) / 6
    ahead = (torch.stack(slopes) * four).sum(0) / 2
    outwards = torch.stack([ahead[:, 1], -ahead[:, 0]], -1)
    return place, ahead, torch.nn.functional.normalize(outwards, dim=-1)


def radii(solid: Relief, direction: Float[Tensor, "n 3"]) -> tuple[Float[Tensor, " n"], Float[Tensor, "n 3"]]:
    """Distance of the surface from the centre along unit directions, and its gradient on the sphere of directions."""
    value, gradient = torch.ones_like(direction[:, 0]), torch.zeros_like(direction)
    for swell in solid.swells:
        axis = direction.new_tensor(swell.axis)
        part = swell.height * (swell.sharpness * (direction @ axis - 1)).exp()
        value += part
        gradient += (swell.sharpness * part)[:, None] * axis
    for amplitude, vector, phase in waves(solid.longest, solid.shortest, solid.seed):
        wave = direction.new_tensor(vector)
        angle = direction @ wave + phase
        value += solid.ripple * amplitude * angle.sin()
        gradient += (solid.ripple * amplitude * angle.cos())[:, None] * wave
    along = (gradient * direction).sum(-1, keepdim=True)
    return solid.radius * value, solid.radius * (gradient - along * direction)


def _turned_cells(solid: Turned, spacing: float) -> Cells:
    """Rings of equal width along the profile, each of equal cells; axes: around, along the profile, outwards."""
    fine = np.linspace(-0.5, len(solid.profile) - 0.5, PROFILE_PLACES)
    steps = np.diff(profile(solid, torch.from_numpy(fine))[0].numpy(), axis=0)
    length = np.concatenate([[0.0], np.linalg.norm(steps, axis=-1).cumsum()])
    rings = math.ceil(length[-1] / spacing)
    t = torch.from_numpy(np.interp((np.arange(rings) + 0.5) / rings * length[-1], length, fine))
    place, _, outwards = profile(solid, t)
    count = (2 * math.pi * place[:, 0] / spacing).ceil().long()
    ring = torch.arange(rings).repeat_interleave(count)
    number = torch.arange(len(ring)) - (count.cumsum(0) - count)[ring]
    azimuth = 2 * math.pi * (number.double() + 0.5) / count[ring]
    cosine, sine, none = azimuth.cos(), azimuth.sin(), torch.zeros_like(azimuth)

    def turned(flat: Float[Tensor, "rings 2"]) -> Float[Tensor, "cells 3"]:
        away, up = flat[ring].unbind(-1)
        return torch.stack([away * cosine, away * sine, up], -1)

    around = torch.stack([-sine, cosine, none], -1)
    ahead = torch.stack([-outwards[:, 1], outwards[:, 0]], -1)
    width = 2 * math.pi * place[:, 0] / count
    size = torch.stack([width[ring], torch.full_like(azimuth, float(length[-1]) / rings)], -1)
    centre = turned(place) + t.new_tensor(solid.centre)
    return centre, torch.stack([around, turned(ahead), turned(outwards)], -1), size


def _relief_cells(solid: Relief, count: int) -> Cells:
    """A spherical Fibonacci lattice of directions; axes: up the gradient of the radius, across it, outwards."""
    direction = sphere_directions(count)
    radius, gradient = radii(solid, direction)
    steep = gradient.norm(dim=-1)
    up = torch.where(
        steep[:, None] > 0, torch.nn.functional.normalize(gradient, dim=-1), tangent_frame(direction)[..., 0]
    )
    normal = torch.nn.functional.normalize(radius[:, None] * direction - gradient, dim=-1)
    first = torch.nn.functional.normalize(radius[:, None] * up + steep[:, None] * direction, dim=-1)
    size = math.sqrt(4 * math.pi / count) * torch.stack([(radius.square() + steep.square()).sqrt(), radius], -1)
    centre = direction * radius[:, None] + direction.new_tensor(solid.centre)
    return centre, torch.stack([first, torch.linalg.cross(normal, first), normal], -1), size
