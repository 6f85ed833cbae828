"""The cube that bounds a field, and its occupied cells: those inside the silhouettes of all training views."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import max_pool2d, max_pool3d

from radiogs_core.errors import DataError
from radiogs_core.learning.views import TrainingView
from radiogs_core.scene.scene import Scene

POINTS_AT_ONCE = 1 << 18
"""Points projected in one batch."""

MARGIN = 2
"""Cells of margin around the region that the silhouettes allow."""


@dataclass(frozen=True)
class Box:
    """A cube in the world with an occupancy grid.

    Positions and lengths in the box are *local*: the cube is [-1, 1]^3, and a length of 1 is half an edge.
    """

    centre: Float[Tensor, "3"]
    """Centre of the cube, world."""
    radius: float
    """Half the length of an edge, world units."""
    occupied: Bool[Tensor, "cells cells cells"]
    """Whether each cell, by x, y and z, may have density; all other cells are empty."""

    @property
    def cells(self) -> int:
        """Number of cells along an edge."""
        return len(self.occupied)

    def local(self, position: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Convert world positions to local ones."""
        return (position - self.centre) / self.radius

    def holds(self, position: Float[Tensor, "*batch 3"]) -> Bool[Tensor, "*batch"]:
        """Whether local positions lie in occupied cells; False outside the cube."""
        cell = ((position + 1) * (self.cells / 2)).floor()
        inside = ((cell >= 0) & (cell < self.cells)).all(-1)
        x, y, z = cell.clamp(0, self.cells - 1).long().unbind(-1)
        return inside & self.occupied.flatten()[(x * self.cells + y) * self.cells + z]

    def narrowed(self, occupied: Bool[Tensor, "cells cells cells"]) -> "Box":
        """The cube with the cells occupied that are occupied in both grids."""
        return Box(self.centre, self.radius, self.occupied & occupied)

    def tensors(self) -> dict[str, Any]:
        """The box as plain values, for ``of``."""
        return {"centre": self.centre, "radius": self.radius, "occupied": self.occupied}

    @classmethod
    def of(cls, tensors: Mapping[str, Any], device: torch.device) -> "Box":
        """The inverse of ``tensors``, with tensors on ``device``."""
        return cls(tensors["centre"].to(device), tensors["radius"], tensors["occupied"].to(device))


def cell_centres(cells: int, **like: Any) -> Float[Tensor, "{cells}*{cells}*{cells} 3"]:
    """Local positions of the centres of all cells, in the order of the flattened ``Box.occupied``."""
    axis = (torch.arange(cells, **like) + 0.5) * (2 / cells) - 1
    return torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij"), -1).flatten(0, 2)


def box_of(scene: Scene, views: Sequence[TrainingView], cells: int) -> Box:
    """The smallest cube around the cells that the silhouettes of all views allow, with their occupancy.

    The search starts from the cube around the ball that every view shows completely. Raises DataError if no cell is
    allowed.
    """
    device = views[0].device
    centre = scene.centre.to(device, torch.float32)
    everywhere = torch.ones(cells, cells, cells, dtype=torch.bool, device=device)
    whole = _allowed(Box(centre, seen_radius(scene), everywhere), views)
    position = cell_centres(cells, device=device)[whole.occupied.flatten()]
    if not len(position):
        raise DataError(
            f"no point of scene '{scene.name}' lies inside the silhouettes of all its training views",
            "The alpha maps and the camera poses contradict each other.",
            f"Check the scene:  radiogs-bench datasets check {scene.name}",
        )
    low, high = position.amin(0), position.amax(0)
    share = min(1.0, float((high - low).max()) / 2 + (2 * MARGIN + 1) / cells)
    middle = whole.centre + whole.radius * (low + high) / 2
    return _allowed(Box(middle, whole.radius * share, whole.occupied), views)


def seen_radius(scene: Scene) -> float:
    """Radius, world units, of the largest ball about the scene's centre that every training view shows completely."""
    centre = scene.centre
    return min(
        float((view.camera.centre.double() - centre).norm())
        * math.sin(math.atan(min(view.camera.width / view.camera.fx, view.camera.height / view.camera.fy) / 2))
        for view in scene.train
    )


def _allowed(box: Box, views: Sequence[TrainingView]) -> Box:
    """The cube with the cells that touch the silhouette in every view whose frame contains them."""
    position = box.centre + box.radius * cell_centres(box.cells, device=box.centre.device)
    reach = box.radius / box.cells * math.sqrt(3)
    possible = torch.ones(len(position), dtype=torch.bool, device=position.device)
    for view in views:
        left = torch.nonzero(possible)[:, 0]
        for some in left.split(POINTS_AT_ONCE):
            possible[some] = _may_show(view, position[some], reach)
    return Box(box.centre, box.radius, possible.view(box.cells, box.cells, box.cells))


def _may_show(view: TrainingView, position: Float[Tensor, "points 3"], reach: float) -> Bool[Tensor, " points"]:
    """Whether the silhouette comes within ``reach`` (world units) of each point, or the point is outside the frame."""
    camera = view.camera
    depth = camera.depth_of(position)
    before = depth > reach
    local = (position - camera.centre) @ camera.axes / torch.where(before, depth, 1.0)[:, None]
    column, row = local[:, 0] * camera.fx + camera.cx, local[:, 1] * camera.fy + camera.cy
    in_frame = before & (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    if not bool(in_frame.any()):
        return ~in_frame
    # Upper bound of the distance, in pixels, between a cell's centre and its corners in the image.
    nearest = float(depth[in_frame].min()) - reach
    slope = math.hypot(1.0, camera.width / camera.fx, camera.height / camera.fy)
    pixels = math.ceil(reach * slope * max(camera.fx, camera.fy) / max(nearest, reach)) + 1
    pixels = min(pixels, max(camera.width, camera.height))
    may_cover = view.mask > 0 if view.valid is None else (view.mask > 0) | ~view.valid
    covered = may_cover.float()[None, None]
    for axes in ((2 * pixels + 1, 1), (1, 2 * pixels + 1)):
        covered = max_pool2d(covered, axes, stride=1, padding=(axes[0] // 2, axes[1] // 2))
    inside = torch.where(in_frame, row, 0.0).long() * camera.width + torch.where(in_frame, column, 0.0).long()
    return ~in_frame | (covered.flatten()[inside] > 0)


def widened(cells: Bool[Tensor, "cells cells cells"]) -> Bool[Tensor, "cells cells cells"]:
    """Dilate the cells by their 26 neighbours."""
    return max_pool3d(cells.float()[None, None], 3, stride=1, padding=1)[0, 0] > 0
