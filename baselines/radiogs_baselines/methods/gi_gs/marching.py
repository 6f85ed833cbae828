"""Screen-space ray marching: the pixel that each direction of a point hits, found in the depth map of the frame.

Surfaces outside the frame, or hidden behind others, are never hit.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.transport.sampling import tangent_frame

from .gbuffer import GBuffer
from .grid import Grid
from .settings import WHOLE_MARCH, Variant

LOOKUPS_AT_ONCE = 1 << 20
"""Positions that are looked up in one batch, at about 50 bytes each. In addition, a frame keeps 4 bytes for each point
and direction: 1.2 GB for 800 x 800 covered pixels and the 480 directions of preset ``paper``."""

NO_HIT = -1
"""Pixel index of a direction that hits no surface."""


@dataclass(frozen=True)
class March:
    """Settings of screen-space marches along a grid of directions; lengths in world units."""

    grid: Grid
    """Directions about each point's normal."""
    distances: tuple[float, ...]
    """Distances from the point at which each march reads the depth map, ascending, in units of the march's length."""
    radius: float
    """Length of a march at depth 0 (``Variant.radius``)."""
    bias: float
    """Distance behind the marched position up to which a surface counts as hit (``Variant.bias``)."""
    thick: float
    """Distance before the marched position up to which a surface counts as hit (``Variant.thick``)."""
    far: float
    """Depth over which the length of a march grows (``Variant.far``)."""

    @classmethod
    def of(cls, grid: Grid, variant: Variant, steps: int, extent: float, start: int) -> "March":
        """March settings of a variant.

        ``steps``: steps in a radius. ``start``: first step, in sixteenths of the radius. ``extent``: the scene's
        extent, world units.
        """
        distances = tuple(step / steps for step in range(steps) if step * WHOLE_MARCH >= start * steps)
        lengths = (extent * length for length in (variant.radius, variant.bias, variant.thick, variant.far))
        return cls(grid, distances, *lengths)

    @torch.no_grad()
    def hit_pixels(self, buffer: GBuffer) -> Int[Tensor, "points directions"]:
        """Index (row * width + column) of the first pixel that each direction hits, or ``NO_HIT``; int32.

        A marched position p + s w hits the surface of its pixel if that surface's depth is at most ``bias`` greater
        and at most ``thick`` less than the depth of the position.
        """
        grid = self.grid.like(buffer.position)
        count = len(grid.direction)
        found = torch.full((len(buffer), count), NO_HIT, dtype=torch.int32, device=buffer.position.device)
        for some in torch.arange(len(buffer), device=found.device).split(max(1, LOOKUPS_AT_ONCE // count)):
            normal = buffer.normal[some] @ buffer.camera.axes
            direction = grid.direction @ tangent_frame(normal).mT
            found[some] = self._hits_along(buffer, buffer.position[some], direction)
        return found

    def _hits_along(
        self, buffer: GBuffer, position: Float[Tensor, "points 3"], direction: Float[Tensor, "points directions 3"]
    ) -> Int[Tensor, "points directions"]:
        camera, outside = buffer.camera, buffer.depth.numel()
        depth = torch.cat([buffer.depth.flatten(), buffer.depth.new_full((1,), torch.inf)])
        # (column z, row z, z) of a position is linear along a march.
        onto = position.new_tensor([[camera.fx, 0, 0], [0, camera.fy, 0], [camera.cx, camera.cy, 1]])
        length = self.radius * (1 + position[:, 2:] / self.far).square()
        begin = (position @ onto)[:, None].unbind(-1)
        along = (length[..., None] * (direction @ onto)).unbind(-1)
        found = torch.full(direction.shape[:2], NO_HIT, dtype=torch.int64, device=position.device)
        for distance in self.distances:
            x, y, z = (first + distance * step for first, step in zip(begin, along, strict=True))
            column, row = x / z, y / z
            inside = (z > 0) & (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
            pixel = torch.where(inside, row.long() * camera.width + column.long(), outside)
            surface = depth[pixel]
            hit = (surface <= z + self.bias) & (surface >= z - self.thick)
            found = torch.where(hit & (found == NO_HIT), pixel, found)
        return found.to(torch.int32)
