"""What the rasterizer and the tracer share: the surfel as a kernel sees it, and its cut-offs.

A surfel is the Gaussian exp(-(u^2 + v^2) / 2) on a plane; (u, v) of a point x are axis_u . (x - centre) and
axis_v . (x - centre). For a traced surfel axis_u = t_u / s_u and axis_v = t_v / s_v, the tangents over the scales. As a
camera sees it, widened by the footprint of a pixel, the axes need not be perpendicular. A ray o + t d meets the plane
at t = n . (centre - o) / (n . d).
"""

from dataclasses import dataclass, fields

from jaxtyping import Float
from torch import Tensor

ALPHA_THRESHOLD = 1 / 255
"""A hit weaker than one 8-bit level is no hit; it bounds the surfel's support (``support.Support``)."""

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
