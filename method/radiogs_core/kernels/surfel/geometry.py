"""Surfel geometry for the rasterizer and the tracer, and the thresholds of both.

A surfel is the Gaussian exp(-(u^2 + v^2) / 2) on a plane; (u, v) of a point x are axis_u . (x - centre) and
axis_v . (x - centre). For the tracer axis_u = t_u / s_u and axis_v = t_v / s_v, the tangents over the scales. For a
camera, which widens surfels by the footprint of a pixel, the axes need not be perpendicular. A ray o + t d intersects
the plane at t = n . (centre - o) / (n . d).
"""

from dataclasses import dataclass, fields

from jaxtyping import Float
from torch import Tensor

ALPHA_THRESHOLD = 1 / 255
"""Least alpha of a hit, one 8-bit level; it bounds the support of a surfel (``support.Support``)."""

MAX_ALPHA = 0.99
"""Largest alpha of a hit; it keeps 1 / (1 - alpha) <= 100 in the backward pass."""

RASTER_TRANSMITTANCE_STOP = 1e-4
"""Transmittance below which a pixel ends: (1 - MAX_ALPHA)^2, the transmittance behind two opaque surfels."""

TRACE_TRANSMITTANCE_STOP = 0.03
"""Transmittance below which a ray ends (paper, appendix on the tracer)."""


@dataclass(frozen=True)
class SplatGeometry:
    """Geometry of N surfels for the kernels; gradients flow to every field."""

    centre: Float[Tensor, "surfels 3"]
    """Positions in the world, world units."""
    axis_u: Float[Tensor, "surfels 3"]
    """First axis in the surfel's plane, 1 / world units (see the module)."""
    axis_v: Float[Tensor, "surfels 3"]
    """Second axis in the surfel's plane, 1 / world units."""
    normal: Float[Tensor, "surfels 3"]
    """Unit normals of the front sides, in the world: rays with n . d < 0 hit the front side."""
    opacity: Float[Tensor, " surfels"]
    """Peak opacity in [0, 1]."""

    def __len__(self) -> int:
        return self.centre.shape[0]

    def detach(self) -> "SplatGeometry":
        """A copy of the surfels without gradient."""
        return SplatGeometry(*(getattr(self, field.name).detach() for field in fields(self)))
