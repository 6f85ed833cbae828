"""The surfaces of a recipe's solids as samples: points, frames and materials that are known exactly."""

import itertools
import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Scene
from radiogs_core.scene.surfaces import Surfaces, SurfaceSamples
from radiogs_core.transport.sampling import sphere_directions, tangent_frame

from ..bounded_reading import read_json
from . import rounds, trefoil
from .catalogue import RECIPES
from .recipe import pinhole
from .solids import GAP, Box, Knot, Relief, Solid, Sphere, Turned

TOUCHING = 1.5 * GAP
"""Solids within this distance touch: no camera sees the space between them."""

PLACES = 1024
"""Number of a rig's cameras in which a scene's cameras are searched; no generated scene has as many."""

NEAR = 1e-4
"""Largest distance between equal poses, in units of the rig's radius: files have fewer digits."""

PROBES = 256
"""Places along and around a knot at which the stretch of its parameter is measured."""


def surfaces_of_scene(folder: Path, scene: Scene) -> Surfaces | None:
    """The surfaces of a scene that ``generate`` has made, at any size of its images; None for any other folder.

    The recipe is read from ``metadata.json``. Other programs write files of this name, too: a file without a recipe's
    name does not count. Neither does one beside other cameras than the recipe's: a scaled, moved or turned scene keeps
    the file, but not its surfaces.
    """
    name = metadata_of(folder).get("scene")
    recipe = RECIPES.get(name) if isinstance(name, str) else None
    if recipe is None:
        return None
    places = torch.from_numpy(np.stack([pinhole(recipe.rig, place, 1).to_world[:3, 3] for place in range(PLACES)]))
    stand = torch.stack([view.camera.centre for view in (*scene.train, *scene.test)]).double()
    at_places = bool((torch.cdist(stand, places).amin(-1) < NEAR * recipe.rig.radius).all())
    return partial(surfaces_of, recipe.solids) if at_places else None


def metadata_of(folder: Path) -> Mapping[str, Any]:
    """The content of ``metadata.json`` in a scene's folder; empty if the file is missing or is not a JSON object."""
    try:
        about = read_json(folder / "metadata.json")
    except DataError:
        return {}
    return about if isinstance(about, dict) else {}


def surfaces_of(solids: Sequence[Solid], spacing: float) -> SurfaceSamples:
    """Samples about ``spacing`` (world units) apart over all solids, facing outwards. Float64.

    Parts of a face on which another solid stands are left out.
    """
    patches, materials = [], []
    for place, solid in enumerate(solids):
        others = [other for number, other in enumerate(solids) if number != place]
        for patch in _patches(solid, others, spacing):
            covered = torch.zeros(len(patch[0]), dtype=torch.bool)
            for other in others:
                covered |= _inside(other, patch[0], TOUCHING)
            patches.append([part[~covered] for part in patch])
            x, y, z = patches[-1][0].unbind(-1)
            materials.append(torch.stack(solid.material.at(x, y, z, torch), -1))
    values = torch.cat(materials)
    centre, frame, size = (torch.cat(parts) for parts in zip(*patches, strict=True))
    return SurfaceSamples(centre=centre, frame=frame, size=size, albedo=values[:, :3], roughness=values[:, 3])


def _patches(solid: Solid, others: Sequence[Solid], spacing: float) -> list[rounds.Cells]:
    if isinstance(solid, Sphere):
        return [_sphere(solid, spacing)]
    if isinstance(solid, Knot):
        return [_tube(solid, spacing)]
    if isinstance(solid, Turned | Relief):
        return [rounds.cells(solid, spacing)]
    return [_face(solid, others, spacing, axis, side) for axis, side in itertools.product(range(3), (0, 1))]


def _sphere(solid: Sphere, spacing: float) -> rounds.Cells:
    """A spherical Fibonacci lattice."""
    count = math.ceil(4 * math.pi * solid.radius**2 / spacing**2)
    normal = sphere_directions(count)
    step = solid.radius * math.sqrt(4 * math.pi / count)
    centre = torch.tensor(solid.centre, dtype=torch.float64) + solid.radius * normal
    return centre, tangent_frame(normal), torch.full((count, 2), step, dtype=torch.float64)


def _tube(solid: Knot, spacing: float) -> rounds.Cells:
    """An even grid over the tube's parameters, sheared where the grid twists around the curve."""
    around = math.ceil(2 * math.pi * solid.radius / spacing)
    longest = float(trefoil.stretch(solid, *trefoil.grid(PROBES, PROBES)).max())
    along = math.ceil(2 * math.pi * longest / spacing)
    t, s = trefoil.grid(along, around)
    width = torch.full_like(t, 2 * math.pi * solid.radius / around)
    size = torch.stack([width, trefoil.stretch(solid, t, s) * (2 * math.pi / along)], -1)
    return trefoil.points(solid, t, s), trefoil.frames(solid, t, s), size


def _face(solid: Box, others: Sequence[Solid], spacing: float, axis: int, side: int) -> rounds.Cells:
    """One side of a box; its grid has lines where boxes that touch it begin, so that cells are covered whole or not."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    plane = (solid.low, solid.high)[side][axis]
    near = [
        other for other in others
        if isinstance(other, Box) and other.low[axis] - TOUCHING <= plane <= other.high[axis] + TOUCHING
    ]  # fmt: skip
    steps = []
    for along in (first, second):
        low, high = solid.low[along], solid.high[along]
        cuts = {edge for other in near for edge in (other.low[along], other.high[along]) if low < edge < high}
        steps.append(_cells([low, *sorted(cuts), high], spacing))
    (u, du), (v, dv) = steps
    centre = torch.empty(len(u), len(v), 3, dtype=torch.float64)
    centre[..., first], centre[..., second], centre[..., axis] = u[:, None], v, plane
    sizes = torch.broadcast_tensors(du[:, None], dv)
    unit = torch.eye(3, dtype=torch.float64)
    axes = (unit[first], unit[second], unit[axis]) if side else (unit[second], unit[first], -unit[axis])
    frame, size = torch.stack(axes, -1), torch.stack(sizes if side else sizes[::-1], -1)
    count = len(u) * len(v)
    return centre.view(count, 3), frame.expand(count, 3, 3), size.reshape(count, 2)


def _cells(edges: Sequence[float], spacing: float) -> tuple[Float[Tensor, " cells"], Float[Tensor, " cells"]]:
    """Middles and widths of the cells between edges; they narrow to an eighth towards each, where Gaussians spill."""
    middles, widths = [], []
    for low, high in itertools.pairwise(edges):
        rim = spacing * torch.tensor([0.125, 0.25, 0.5], dtype=torch.float64)
        inner = high - low - 2 * float(rim.sum())
        if inner > 0:
            count = math.ceil(inner / spacing)
            width = torch.cat([rim, torch.full((count,), inner / count, dtype=torch.float64), rim.flip(0)])
        else:
            count = math.ceil((high - low) / float(rim[0]))
            width = torch.full((count,), (high - low) / count, dtype=torch.float64)
        middles.append(low + width.cumsum(0) - width / 2)
        widths.append(width)
    return torch.cat(middles), torch.cat(widths)


def _inside(solid: Solid, points: Float[Tensor, "points 3"], margin: float) -> Bool[Tensor, " points"]:
    if isinstance(solid, Sphere):
        return (points - torch.tensor(solid.centre, dtype=torch.float64)).norm(dim=-1) < solid.radius + margin
    if isinstance(solid, Knot):
        return trefoil.inside(solid, points, margin)
    if isinstance(solid, Turned | Relief):
        return rounds.inside(solid, points, margin)
    low, high = (torch.tensor(corner, dtype=torch.float64) for corner in (solid.low, solid.high))
    return ((points > low - margin) & (points < high + margin)).all(-1)
