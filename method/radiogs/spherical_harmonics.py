"""Directional radiance of a surfel: real spherical harmonics up to degree 3, in the basis and signs of 3DGS."""

import torch
from jaxtyping import Float
from torch import Tensor

COEFFICIENTS = 16
"""Coefficients of degrees 0 to 3."""

CONSTANT_BASIS = 0.28209479177387814
"""The degree-0 basis function, 1 / (2 sqrt(pi))."""


def basis(direction: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 16"]:
    """The 16 basis functions at unit directions of travel (from the viewer to the surfel)."""
    x, y, z = direction.unbind(-1)
    xx, yy, zz = x * x, y * y, z * z
    return torch.stack(
        [
            torch.full_like(x, CONSTANT_BASIS),
            -0.4886025119029199 * y,
            0.4886025119029199 * z,
            -0.4886025119029199 * x,
            1.0925484305920792 * x * y,
            -1.0925484305920792 * y * z,
            0.31539156525252005 * (2 * zz - xx - yy),
            -1.0925484305920792 * x * z,
            0.5462742152960396 * (xx - yy),
            -0.5900435899266435 * y * (3 * xx - yy),
            2.890611442640554 * x * y * z,
            -0.4570457994644658 * y * (4 * zz - xx - yy),
            0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
            -0.4570457994644658 * x * (4 * zz - xx - yy),
            1.445305721320277 * z * (xx - yy),
            -0.5900435899266435 * x * (xx - 3 * yy),
        ],
        -1,
    )


def surfel_radiance(
    sh: Float[Tensor, "surfels coefficients 3"], outgoing: Float[Tensor, "surfels *views 3"]
) -> Float[Tensor, "surfels *views 3"]:
    """Radiance L_G that each surfel sends along unit ``outgoing`` directions (away from the surface), linear RGB.

    value = max(0, SH(-outgoing) + 1/2): 3DGS evaluates its harmonics along the direction of travel.
    """
    return unclamped_radiance(sh, outgoing).clamp(min=0)


def unclamped_radiance(
    sh: Float[Tensor, "surfels coefficients 3"], outgoing: Float[Tensor, "surfels *views 3"]
) -> Float[Tensor, "surfels *views 3"]:
    """``surfel_radiance`` before it is cut off at zero: what has fallen below still has a gradient that lifts it."""
    values = basis(-outgoing)[..., : sh.shape[1]]
    # A product and a sum: batched multiplication of thousands of 1 x 16 by 16 x 3 matrices measured slower.
    coefficients = sh.view(len(sh), *[1] * (outgoing.dim() - 2), *sh.shape[1:])
    return (values[..., None] * coefficients).sum(-2) + 0.5
