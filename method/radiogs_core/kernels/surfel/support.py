"""K13: how far a surfel reaches, and whether a ray can meet it at all."""

from dataclasses import dataclass, fields

import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from ...instruments import fire
from ..runtime import launch_in_parallel
from .geometry import SplatGeometry
from .support_source import DEGENERATE, FAINT, MET, SATURABLE, support_kernel


@dataclass(frozen=True)
class Support:
    """Where surfels are stronger than one grey level, without gradient.

    radius: in units of the scale, sqrt(2 ln(255 o)) or 0. extent: half of the axis-aligned box around the ellipse,
    world units. kind: one of ``support_source``.

    The ellipse is centre + k (cos(a) U + sin(a) V), where U and V are dual to the axes (axis_u . U = 1, axis_u . V =
    0): its half-extent along a world axis e is k |(U.e, V.e)|.
    """

    radius: Float[Tensor, " surfels"]
    extent: Float[Tensor, "surfels 3"]
    kind: UInt8[Tensor, " surfels"]

    @property
    def can_be_met(self) -> Bool[Tensor, " surfels"]:
        """Whether a ray can meet the surfel: every number finite, neither axis zero, opacity above the cut-off.

        A surfel that fails (scale of zero or infinity, a NaN anywhere) takes no part: it is neither drawn nor traced.
        """
        return self.kind >= MET

    def counted(self) -> "Support":
        """This, its guards counted: once for every set of surfels that is binned or fitted into a tree."""
        fire(
            degenerate_surfels=(self.kind == DEGENERATE).sum(),
            faint_surfels=(self.kind == FAINT).sum(),
            saturable_surfels=(self.kind == SATURABLE).sum(),
        )
        return self


@torch.no_grad()
def support_of(geometry: SplatGeometry) -> Support:
    """The supports of surfels."""
    supports = support_kernel(geometry.centre.dtype)
    given = [getattr(geometry, field.name).detach().contiguous() for field in fields(geometry)]
    radius, extent = torch.empty_like(given[-1]), torch.empty_like(given[0])
    kind = torch.empty(len(radius), dtype=torch.uint8, device=radius.device)
    arguments = [*given, radius, extent, kind]
    launch_in_parallel(supports, len(radius), radius.device, lambda _: arguments)
    return Support(radius, extent, kind)
