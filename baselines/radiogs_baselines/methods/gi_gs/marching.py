"""Looking around on the screen: which pixel each direction of a point meets, found in the depth map of the frame.

What the frame does not show, because it lies outside or behind something, is not there.
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
"""Places that are looked up together: some 50 bytes each. Beside them, a frame keeps 4 bytes a point and direction:
1.2 GB for 800 x 800 covered pixels and all 480 directions of preset ``paper``."""

NOTHING = -1
"""In the place of a pixel where a direction meets none."""


@dataclass(frozen=True)
class March:
    """Marches along a grid of directions; lengths in world units, see ``Variant``.

    places: where each march looks, in radii, in order.
    """

    grid: Grid
    places: tuple[float, ...]
    radius: float
    bias: float
    thick: float
    far: float

    @classmethod
    def of(cls, grid: Grid, variant: Variant, steps: int, extent: float, start: int) -> "March":
        """Marches of ``steps`` a radius, from ``start`` sixteenths of it on; ``extent``: the scene's, world units."""
        places = tuple(step / steps for step in range(steps) if step * WHOLE_MARCH >= start * steps)
        lengths = (extent * length for length in (variant.radius, variant.bias, variant.thick, variant.far))
        return cls(grid, places, *lengths)

    @torch.no_grad()
    def met(self, buffer: GBuffer) -> Int[Tensor, "points directions"]:
        """The pixel (row * width + column) whose surface each direction meets first, or ``NOTHING``; int32.

        At each place p + s w the surface of the pixel there counts as met if its depth is at most ``bias`` more and
        at most ``thick`` less than that of the place.
        """
        grid = self.grid.like(buffer.place)
        count = len(grid.direction)
        found = torch.full((len(buffer), count), NOTHING, dtype=torch.int32, device=buffer.place.device)
        for some in torch.arange(len(buffer), device=found.device).split(max(1, LOOKUPS_AT_ONCE // count)):
            normal = buffer.normal[some] @ buffer.camera.axes
            direction = grid.direction @ tangent_frame(normal).mT
            found[some] = self._met_along(buffer, buffer.place[some], direction)
        return found

    def _met_along(
        self, buffer: GBuffer, place: Float[Tensor, "points 3"], direction: Float[Tensor, "points directions 3"]
    ) -> Int[Tensor, "points directions"]:
        camera, outside = buffer.camera, buffer.depth.numel()
        depth = torch.cat([buffer.depth.flatten(), buffer.depth.new_full((1,), torch.inf)])
        # A place is (column z, row z, z): linear along a march, as the place itself.
        onto = place.new_tensor([[camera.fx, 0, 0], [0, camera.fy, 0], [camera.cx, camera.cy, 1]])
        length = self.radius * (1 + place[:, 2:] / self.far).square()
        begin = (place @ onto)[:, None].unbind(-1)
        along = (length[..., None] * (direction @ onto)).unbind(-1)
        found = torch.full(direction.shape[:2], NOTHING, dtype=torch.int64, device=place.device)
        for share in self.places:
            x, y, z = (first + share * step for first, step in zip(begin, along, strict=True))
            column, row = x / z, y / z
            inside = (z > 0) & (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
            pixel = torch.where(inside, row.long() * camera.width + column.long(), outside)
            surface = depth[pixel]
            meets = (surface <= z + self.bias) & (surface >= z - self.thick)
            found = torch.where(meets & (found == NOTHING), pixel, found)
        return found.to(torch.int32)
