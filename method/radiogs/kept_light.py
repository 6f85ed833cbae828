"""The light that surfels keep when no more rays are traced from them."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from radiogs_core.transport.incident import Incident
from radiogs_core.transport.tracer import SurfelTracer, incident_along

CELLS = 16
"""Cells along each side of the square to which a hemisphere is mapped: 256 cells are about 9 degrees wide."""

DIRECTIONS_AT_ONCE = 1 << 20
"""Directions that are looked up together; each takes some fifty bytes meanwhile."""


@dataclass(frozen=True)
class KeptLight:
    """V and L_ind of surfels when rays were last traced from them, in the cells of their hemispheres.

    The hemisphere around a normal is projected to the octahedron with |x| + |y| + z = 1, whose upper half fills a
    square that is turned by 45 degrees (Cigolle et al. 2014, "A Survey of Efficient Representations for Independent
    Unit Vectors"). A ray is traced through the middle of each cell.
    """

    frame: Float[Tensor, "surfels 3 3"]
    """Rotation matrices of the surfels at that time, with columns t_u, t_v, n."""
    visibility: Float[Tensor, "surfels cells"]
    radiance: Float[Tensor, "surfels cells 3"]

    @classmethod
    def traced(cls, tracer: SurfelTracer) -> "KeptLight":
        """The light on the surfels of ``tracer``, traced now."""
        frame = tracer.surfels.frame.detach()
        direction = normalize(middles(frame), dim=-1) @ frame.transpose(1, 2)
        light = incident_along(tracer, direction, torch.ones_like(direction[..., 0]))
        return cls(frame, light.visibility, light.radiance)

    def through(self, some: Int[Tensor, " some"]) -> Incident:
        """The light through the middles of some cells, which share the hemisphere by their solid angles."""
        middle = middles(self.frame)[some]
        share = middle.norm(dim=-1) ** -3
        weight = (2 * torch.pi * share / share.sum()).repeat(len(self.frame), 1)
        direction = normalize(middle, dim=-1) @ self.frame.transpose(1, 2)
        return Incident(direction, weight, self.visibility[:, some], self.radiance[:, some])

    @torch.no_grad()
    def along(
        self,
        direction: Float[Tensor, "chosen samples 3"],
        weight: Float[Tensor, "chosen samples"],
        index: Int[Tensor, " chosen"] | None = None,
    ) -> Incident:
        """The light on the surfels at ``index`` (None: all) along unit directions with these solid angles."""
        visibility, radiance = torch.empty_like(weight), torch.empty_like(direction)
        index = torch.arange(len(self.frame), device=self.frame.device) if index is None else index
        every, at_once = torch.arange(len(index), device=index.device), DIRECTIONS_AT_ONCE // direction.shape[1]
        for rows in every.split(max(1, at_once)):
            surfels = index[rows]
            place = surfels[:, None] * CELLS**2 + cells(direction[rows] @ self.frame[surfels])
            visibility[rows] = self.visibility.flatten()[place]
            radiance[rows] = self.radiance.flatten(0, 1)[place]
        return Incident(direction, weight, visibility, radiance)


def cells(local: Float[Tensor, "*batch 3"]) -> Int[Tensor, "*batch"]:
    """The cells of unit directions in the frame of their surfel; of a direction below the surface, one at its rim."""
    x, y, z = local.unbind(-1)
    length = (x.abs() + y.abs() + z.clamp(min=0)).clamp(min=torch.finfo(local.dtype).tiny)
    row, column = ((CELLS / 2) * (1 + along / length) for along in (x + y, x - y))
    return row.long().clamp(0, CELLS - 1) * CELLS + column.long().clamp(0, CELLS - 1)


def middles(like: Tensor) -> Float[Tensor, "cells 3"]:
    """The middles of all cells on the octahedron, in a surfel's frame. ``like``: same device and type."""
    middle = (torch.arange(CELLS, device=like.device, dtype=like.dtype) + 0.5) * (2 / CELLS) - 1
    x, y = ((middle[:, None] + sign * middle) / 2 for sign in (1, -1))
    return torch.stack([x, y, 1 - x.abs() - y.abs()], -1).flatten(0, 1)
