"""What the rasterizer and the tracer share: the surfel as a kernel sees it, and its cut-offs.

A surfel is the Gaussian exp(-(u^2 + v^2) / 2) on a plane; (u, v) of a point x are axis_u . (x - centre) and
axis_v . (x - centre). For a traced surfel axis_u = t_u / s_u and axis_v = t_v / s_v, the tangents over the scales. As a
camera sees it, widened by the footprint of a pixel, the axes need not be perpendicular. A ray o + t d meets the plane
at t = n . (centre - o) / (n . d).
"""

from dataclasses import dataclass, fields

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ...instruments import fire

ALPHA_THRESHOLD = 1 / 255
"""A hit weaker than one 8-bit level is no hit; it bounds the surfel's support at ``support_radius``."""

MAX_ALPHA = 0.99
"""No surfel hides everything behind it: keeps 1 / (1 - alpha) <= 100 in the backward pass."""

RASTER_TRANSMITTANCE_STOP = 1e-4
"""A pixel is full once less than (1 - MAX_ALPHA)^2 of it is left: what lies behind two opaque surfels."""

TRACE_TRANSMITTANCE_STOP = 0.03
"""A ray is full once less than 3 % of it is left (paper, appendix on the tracer)."""


@dataclass(frozen=True)
class SplatGeometry:
    """N surfels in the world, as the kernels take them; gradients flow to every field.

    ``axis_u`` and ``axis_v`` lie in the surfel's plane (1 / world units); ``normal`` is the unit normal of
    the visible side: a surfel is met only by rays with n . d < 0; ``opacity`` lies in [0, 1].
    """

    centre: Float[Tensor, "surfels 3"]
    axis_u: Float[Tensor, "surfels 3"]
    axis_v: Float[Tensor, "surfels 3"]
    normal: Float[Tensor, "surfels 3"]
    opacity: Float[Tensor, " surfels"]

    def __len__(self) -> int:
        return self.centre.shape[0]

    def detach(self) -> "SplatGeometry":
        """A copy of the surfels without gradient."""
        return SplatGeometry(*(getattr(self, field.name).detach() for field in fields(self)))


def support_radius(opacity: Float[Tensor, " surfels"]) -> Float[Tensor, " surfels"]:
    """Radius, in units of the scale, inside which alpha reaches ALPHA_THRESHOLD: sqrt(2 ln(255 o)), else 0."""
    return (2 * (opacity / ALPHA_THRESHOLD).clamp(min=1).log()).sqrt()


def support_extent(geometry: SplatGeometry) -> Float[Tensor, "surfels 3"]:
    """Half-extent of the axis-aligned box around each surfel's support, in world units, without gradient.

    The support is the ellipse centre + k (cos(a) U + sin(a) V), where U and V are dual to the axes (axis_u . U = 1,
    axis_u . V = 0): its half-extent along a world axis e is k |(U.e, V.e)|.
    """
    with torch.no_grad():
        span_u, span_v = _dual(geometry.axis_u, geometry.axis_v), _dual(geometry.axis_v, geometry.axis_u)
        return support_radius(geometry.opacity)[:, None] * torch.hypot(span_u, span_v)


def _dual(axis: Float[Tensor, "surfels 3"], other: Float[Tensor, "surfels 3"]) -> Float[Tensor, "surfels 3"]:
    """The step in the plane of both axes along which the first coordinate grows by one and the other stays."""
    across = axis - other * ((axis * other).sum(-1, keepdim=True) / other.square().sum(-1, keepdim=True))
    return across / across.square().sum(-1, keepdim=True)


def can_be_met(geometry: SplatGeometry) -> Bool[Tensor, " surfels"]:
    """Whether a ray can meet the surfel at all: every number finite, neither axis zero, opacity above the cut-off.

    A surfel that fails (scale of zero or infinity, a NaN anywhere) takes no part: it is neither drawn nor traced.
    """
    with torch.no_grad():
        return _is_finite(geometry) & (geometry.opacity >= ALPHA_THRESHOLD)


def cull(geometry: SplatGeometry) -> Bool[Tensor, " surfels"]:
    """``can_be_met``, counted: called once for every set of surfels that is binned or fitted into a tree."""
    with torch.no_grad():
        finite = _is_finite(geometry) & ~torch.isnan(geometry.opacity)
        strong = geometry.opacity >= ALPHA_THRESHOLD
        fire(
            degenerate_surfels=(~finite).sum(),
            faint_surfels=(finite & ~strong).sum(),
            saturable_surfels=(finite & (geometry.opacity > MAX_ALPHA)).sum(),
        )
        return finite & strong


def _is_finite(geometry: SplatGeometry) -> Bool[Tensor, " surfels"]:
    vectors = (geometry.axis_u, geometry.axis_v, geometry.normal, support_extent(geometry))
    # Zero times a number is zero; times an infinity, or what is no number, it is none. Six times as fast as isfinite.
    return sum((0 * vector for vector in vectors), 0 * geometry.centre).sum(-1) == 0
