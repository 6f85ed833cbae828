"""Directional radiance of a surfel: real spherical harmonics up to degree 3, in the basis and signs of 3DGS."""

from jaxtyping import Float
from torch import Tensor

from ..kernels.surfel.harmonics import harmonic_sum

COEFFICIENTS = 16
"""Coefficients of degrees 0 to 3."""

CONSTANT_BASIS = 0.28209479177387814
"""The degree-0 basis function, 1 / (2 sqrt(pi))."""


def surfel_radiance(
    sh: Float[Tensor, "surfels coefficients 3"], outgoing: Float[Tensor, "surfels *views 3"]
) -> Float[Tensor, "surfels *views 3"]:
    """Radiance L_G that each surfel sends along unit ``outgoing`` directions (away from the surface), linear RGB.

    L_G = max(0, SH(-outgoing) + 1/2): 3DGS evaluates its harmonics along the direction of travel.
    """
    return unclamped_radiance(sh, outgoing).clamp(min=0)


def unclamped_radiance(
    sh: Float[Tensor, "surfels coefficients 3"], outgoing: Float[Tensor, "surfels *views 3"]
) -> Float[Tensor, "surfels *views 3"]:
    """``surfel_radiance`` without the clamp at zero, so that negative values keep a gradient."""
    views = outgoing.reshape(len(sh), outgoing.shape[1:-1].numel(), 3)
    return harmonic_sum(sh, -views).view(outgoing.shape) + 0.5
