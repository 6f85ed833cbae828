"""The simplified Disney BRDF of the paper (Eq. 4): Lambert plus a GGX microfacet lobe, for dielectrics.

Directions are unit vectors that point away from the surface: ``wo`` to the viewer, ``wi`` to the light.
Roughness r is perceptual, alpha = r^2. The kernel ``shade`` evaluates the same formulas.
"""

import torch
from jaxtyping import Float
from torch import Tensor

FRESNEL_NORMAL = 0.04
"""Reflectance F0 at normal incidence of a dielectric with refractive index 1.5."""


def ggx_distribution(
    half: Float[Tensor, "*batch 3"], normal: Float[Tensor, "*batch 3"], roughness: Float[Tensor, "*batch"]
) -> Float[Tensor, "*batch"]:
    """GGX normal distribution D, per steradian of half-vector.

    Written as alpha^2 c^2 + |n x h|^2 with c = n.h; the textbook c^2 (alpha^2 - 1) + 1 subtracts two numbers near
    one and loses 35 % at roughness 0.02 in float32. No clamp: the denominator is at least alpha^2.
    """
    alpha_squared = roughness.square().square()
    cosine = (half * normal).sum(-1)
    # n x (h - n) is n x h, without products of near-parallel vectors that cancel (float32, roughness 0.02: 5e-7
    # instead of 1e-4).
    sine_squared = torch.linalg.cross(normal, half - normal).square().sum(-1)
    denominator = alpha_squared * cosine.square() + sine_squared
    return torch.where(cosine > 0, alpha_squared / denominator / (torch.pi * denominator), 0.0)


def fresnel(cosine: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    """Schlick's Fresnel term F in its spherical-Gaussian form; ``cosine``: between a direction and the half-vector."""
    return FRESNEL_NORMAL + (1 - FRESNEL_NORMAL) * torch.exp2((-5.55473 * cosine - 6.98316) * cosine)


def smith_visibility(
    view_cosine: Float[Tensor, "*batch"], light_cosine: Float[Tensor, "*batch"], roughness: Float[Tensor, "*batch"]
) -> Float[Tensor, "*batch"]:
    """G / (4 (n.wi) (n.wo)), Schlick-Smith with k = (r + 1)^2 / 8; the cosines of G cancel, so grazing is finite."""
    k = (roughness + 1).square() / 8
    return 0.25 / ((view_cosine * (1 - k) + k) * (light_cosine * (1 - k) + k))


def correlated_visibility(
    view_cosine: Float[Tensor, "*batch"], light_cosine: Float[Tensor, "*batch"], roughness: Float[Tensor, "*batch"]
) -> Float[Tensor, "*batch"]:
    """G / (4 (n.wi) (n.wo)) with the exact, height-correlated Smith term of GGX (Heitz 2014, Eq. 99)."""
    alpha_squared = roughness.square().square()

    def slope(cosine: Tensor) -> Tensor:
        return (alpha_squared + (1 - alpha_squared) * cosine.square()).sqrt()

    total = light_cosine * slope(view_cosine) + view_cosine * slope(light_cosine)
    return 0.5 / total.clamp(min=torch.finfo(total.dtype).tiny)


def specular(
    normal: Float[Tensor, "*batch 3"],
    wo: Float[Tensor, "*batch 3"],
    wi: Float[Tensor, "*batch 3"],
    roughness: Float[Tensor, "*batch"],
) -> Float[Tensor, "*batch"]:
    """f_s = D F G / (4 (n.wi) (n.wo)), per steradian; zero where either direction is below the surface."""
    view_cosine, light_cosine = (normal * wo).sum(-1), (normal * wi).sum(-1)
    above = (view_cosine > 0) & (light_cosine > 0)
    # Below the horizon wo + wi may vanish: any other half-vector keeps the unused branch, and its gradient, finite.
    half = torch.nn.functional.normalize(torch.where(above[..., None], wo + wi, normal), dim=-1)
    lobe = ggx_distribution(half, normal, roughness) * fresnel((half * wo).sum(-1))
    return torch.where(
        above, lobe * smith_visibility(view_cosine.clamp(min=0), light_cosine.clamp(min=0), roughness), 0.0
    )


def diffuse(albedo: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
    """f_d = albedo / pi, per steradian."""
    return albedo / torch.pi
