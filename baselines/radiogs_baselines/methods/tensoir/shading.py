"""Surface points and their shading: L_o = sum_w (a / pi + f_GGX) L_i (n.w) dA."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.kernels.shade.brdf import diffuse, specular

from .marching import Marched, Rays

SOLID = 0.5
"""Coverage above which a ray ends at a surface point; no other is shaded."""


@dataclass(frozen=True)
class Materials:
    """Materials by ray, as the field's samples blend: each times the ray's coverage, ``normal`` of any length."""

    albedo: Float[Tensor, "rays 3"]
    roughness: Float[Tensor, " rays"]
    normal: Float[Tensor, "rays 3"]


@dataclass(frozen=True)
class SurfacePoints:
    """One for each solid ray.

    ray: which. place: local. normal: unit; zero where blended normals cancel, and nothing is received there.
    albedo: linear. outgoing: unit, towards who looks.
    """

    ray: Int[Tensor, " points"]
    place: Float[Tensor, "points 3"]
    normal: Float[Tensor, "points 3"]
    albedo: Float[Tensor, "points 3"]
    roughness: Float[Tensor, " points"]
    outgoing: Float[Tensor, "points 3"]


def surface_points(rays: Rays, marched: Marched, materials: Materials) -> SurfacePoints:
    """Points where rays end on average, with blended materials divided by coverage."""
    alpha = marched.alpha
    ray = torch.nonzero(alpha.detach() > SOLID)[:, 0]
    whole = alpha[ray]
    return SurfacePoints(
        ray=ray,
        place=(rays.origin + marched.distance[:, None] * rays.direction)[ray].detach(),
        normal=unit(materials.normal[ray]),
        albedo=materials.albedo[ray] / whole[:, None],
        roughness=materials.roughness[ray] / whole,
        outgoing=-rays.direction[ray],
    )


def unit(vector: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
    """Of length one; zero stays zero."""
    length = vector.square().sum(-1, keepdim=True)
    return vector * torch.where(length > 0, length, torch.inf).rsqrt()


def transport(
    points: SurfacePoints,
    direction: Float[Tensor, "points directions 3"],
    weight: Float[Tensor, "points directions"],
) -> Float[Tensor, "points directions 3"]:
    """What each direction's radiance is multiplied by: reflectance, cosine and solid angle (``weight``, steradian).

    Zero for directions below the surface.
    """
    normal, outgoing = points.normal[:, None].expand_as(direction), points.outgoing[:, None].expand_as(direction)
    cosine = (normal * direction).sum(-1).clamp(min=0)
    lobe = specular(normal, outgoing, direction, points.roughness[:, None].expand_as(weight))
    return (diffuse(points.albedo)[:, None] + lobe[..., None]) * (cosine * weight)[..., None]
