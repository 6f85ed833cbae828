"""Screen-space ray marching: the pixel that each direction of a fixed grid hits, found in the depth map of the frame.

Surfaces outside the frame, or hidden behind others, are never hit.
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.transport.sampling import tangent_frame

from .gbuffer import GBuffer
from .settings import WHOLE_MARCH, Variant

LOOKUPS_AT_ONCE = 1 << 20
"""Positions that are looked up in one batch, at about 50 bytes each. In addition, a frame keeps 4 bytes for each point
and direction: 1.2 GB for 800 x 800 covered pixels and the 480 directions of preset ``paper``."""

NO_HIT = -1
"""Pixel index of a direction that hits no surface."""


GATHERED = math.pi / (34 * math.tan(math.pi / 32))
"""Share of a constant radiance that the published grid of 32 x 17 directions gathers: 0.938. The published code divides
by the number of all directions, although those along the normal and the horizon add nothing. Here the weights of every
grid are scaled to this share, so that a smaller grid is not darker."""


@dataclass(frozen=True)
class Grid:
    """Directions over the hemisphere about +Z, and their quadrature weights."""

    direction: Float[Tensor, "directions 3"]
    """Unit directions; +Z is the surface normal."""
    cosine_weight: Float[Tensor, " directions"]
    """Weights of the cosine-weighted hemisphere: cosine times sine of the polar angle, normalised to a sum of 1."""
    uniform_weight: Float[Tensor, " directions"]
    """Weights of the unweighted hemisphere: sine of the polar angle, normalised to a sum of 1."""

    @classmethod
    def of(cls, azimuths: int, heights: int) -> "Grid":
        """Grid with equal steps of azimuth and of polar angle, float64.

        ``heights`` counts the polar angles from the normal to the horizon; these two have no weight and are left out.
        """
        polar = torch.arange(1, heights - 1, dtype=torch.float64) * (math.pi / 2 / (heights - 1))
        azimuth = torch.arange(azimuths, dtype=torch.float64) * (2 * math.pi / azimuths)
        polar, azimuth = (angle.flatten() for angle in torch.meshgrid(polar, azimuth, indexing="ij"))
        sine, cosine = polar.sin(), polar.cos()
        direction = torch.stack([sine * azimuth.cos(), sine * azimuth.sin(), cosine], -1)
        weight = sine * cosine
        return cls(direction, weight / weight.sum(), sine / sine.sum())

    def like(self, values: Tensor) -> "Grid":
        """The grid with the device and dtype of ``values``."""
        return Grid(self.direction.to(values), self.cosine_weight.to(values), self.uniform_weight.to(values))


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
