"""K13: the support of surfels, where their alpha is above the threshold, and whether a ray can hit them."""

from dataclasses import dataclass, fields
from functools import cache, partial

import torch
import warp as wp
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from ...instruments import current, fire
from ..lanes import LANES
from ..native_kernel import BYTES, flat, native_file, native_kernel
from ..runtime import ITEMWISE, launch_in_parallel
from .geometry import ALPHA_THRESHOLD, MAX_ALPHA, SplatGeometry

SUPPORT = native_file(__package__, "support.inl", LANES)

SUPPORT_WORDS = {"THRESHOLD": ALPHA_THRESHOLD, "MAX_ALPHA": MAX_ALPHA}
"""The values of the words in ``SUPPORT``."""

DEGENERATE, FAINT, REGULAR, SATURABLE = range(4)
"""Kinds of surfels: degenerate (a value is not finite or an axis is zero), fainter than one 8-bit level, regular ones
that rays can hit, and saturable ones with an opacity above MAX_ALPHA, whose alpha is clipped."""


@dataclass(frozen=True)
class Support:
    """The ellipses in which surfels have an alpha of at least ALPHA_THRESHOLD; no gradient.

    An ellipse is centre + k (cos(a) U + sin(a) V), where U and V are dual to the axes (axis_u . U = 1, axis_u . V = 0).
    Its half-extent along a world axis e is k |(U.e, V.e)|.
    """

    radius: Float[Tensor, " surfels"]
    """Radius k of the ellipse in units of the scale: sqrt(2 ln(255 opacity)) or 0."""
    extent: Float[Tensor, "surfels 3"]
    """Half the sides of the axis-aligned box around the ellipse, world units."""
    kind: UInt8[Tensor, " surfels"]
    """DEGENERATE, FAINT, REGULAR or SATURABLE."""

    @property
    def can_be_hit(self) -> Bool[Tensor, " surfels"]:
        """Whether a ray can hit the surfel: all numbers are finite, no axis is zero, opacity is above the threshold.

        Other surfels (a scale of zero or infinity, any NaN) are skipped: they are neither rasterized nor traced.
        """
        return self.kind >= REGULAR


def count_kinds(kind: UInt8[Tensor, " surfels"]) -> None:
    """Count the guards of surfels by their kinds; call it once for each set of surfels that is binned or fitted."""
    if current() is not None:
        fire(
            degenerate_surfels=(kind == DEGENERATE).sum(),
            faint_surfels=(kind == FAINT).sum(),
            saturable_surfels=(kind == SATURABLE).sum(),
        )


@torch.no_grad()
def support_of(geometry: SplatGeometry) -> Support:
    """The supports of surfels."""
    given = [getattr(geometry, field.name).contiguous() for field in fields(geometry)]
    radius, extent = torch.empty_like(given[-1]), torch.empty_like(given[0])
    kind = torch.empty(len(radius), dtype=torch.uint8, device=radius.device)
    launch_in_parallel(support_kernel(radius.dtype), len(radius), radius.device, [*given, radius, extent, kind])
    return Support(radius, extent, kind)


@cache
def support_kernel(dtype: torch.dtype) -> wp.Kernel:
    """The kernel for a scalar type; an item is a surfel."""
    parameters = (flat(dtype), "centre axis_u axis_v normal opacity radius extent"), (BYTES, "kind")
    make = partial(native_kernel, SUPPORT, dtype, ITEMWISE, on_cuda=True, words=SUPPORT_WORDS)
    return make("support", "surfel", *parameters)
