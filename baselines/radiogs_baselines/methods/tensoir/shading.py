"""Materials along marched rays, their surface points, and shading: L_o = sum_w (a / pi + f_GGX) L_i (n.w) dA."""

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.kernels.shade.brdf import diffuse, specular

from .field import Field
from .marching import Marched, Rays

SOLID = 0.5
"""Coverage above which a ray has a surface point; other rays are not shaded."""


@dataclass(frozen=True)
class Materials:
    """Materials blended along each ray, multiplied by its coverage."""

    albedo: Float[Tensor, "rays 3"]
    """Linear diffuse albedo."""
    roughness: Float[Tensor, " rays"]
    """Perceptual roughness r."""
    normal: Float[Tensor, "rays 3"]
    """Normals of any length, world axes."""


@dataclass(frozen=True)
class SampleValues:
    """Radiance, materials and normals at the counted samples of marched rays."""

    marched: Marched
    """The marched rays."""
    radiance: Float[Tensor, "counted 3"]
    """Radiance towards the ray's origin, linear."""
    albedo: Float[Tensor, "counted 3"]
    """Linear diffuse albedo."""
    roughness: Float[Tensor, " counted"]
    """Perceptual roughness r."""
    predicted: Float[Tensor, "counted 3"]
    """Normals of the network (``Field.predicted_normal``)."""
    derived: Float[Tensor, "counted 3"]
    """Normals of the density (``Field.derived_normal``)."""

    def materials(self, normals: Literal["predicted", "derived"]) -> Materials:
        """Materials blended along each ray, with the selected normals."""
        blended = self.marched.blended
        normal = self.predicted if normals == "predicted" else self.derived
        return Materials(blended(self.albedo), blended(self.roughness), blended(normal))


def sample_values(field: Field, rays: Rays, marched: Marched) -> SampleValues:
    """Evaluate all networks at the counted samples."""
    position = marched.positions
    features = field.features(position)
    albedo, roughness = field.materials(features, position)
    return SampleValues(
        marched=marched,
        radiance=field.radiance(features, rays.direction[marched.ray]),
        albedo=albedo,
        roughness=roughness,
        predicted=field.predicted_normal(features, position),
        derived=field.derived_normal(position),
    )


@dataclass(frozen=True)
class SurfacePoints:
    """Surface points, one for each ray whose coverage is above ``SOLID``."""

    ray: Int[Tensor, " points"]
    """Index of the point's ray."""
    position: Float[Tensor, "points 3"]
    """Local positions."""
    normal: Float[Tensor, "points 3"]
    """Unit normals; zero where blended normals cancel, and such a point receives no light."""
    albedo: Float[Tensor, "points 3"]
    """Linear diffuse albedo."""
    roughness: Float[Tensor, " points"]
    """Perceptual roughness r."""
    outgoing: Float[Tensor, "points 3"]
    """Unit directions towards the viewer."""


def surface_points(rays: Rays, marched: Marched, materials: Materials) -> SurfacePoints:
    """Points at the mean distance of each solid ray, with blended materials divided by coverage."""
    alpha = marched.alpha
    ray = torch.nonzero(alpha.detach() > SOLID)[:, 0]
    coverage = alpha[ray]
    return SurfacePoints(
        ray=ray,
        position=(rays.origin + marched.distance[:, None] * rays.direction)[ray].detach(),
        normal=unit(materials.normal[ray]),
        albedo=materials.albedo[ray] / coverage[:, None],
        roughness=materials.roughness[ray] / coverage,
        outgoing=-rays.direction[ray],
    )


def unit(vector: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
    """Normalise vectors to length one; zero vectors stay zero."""
    length = vector.square().sum(-1, keepdim=True)
    return vector * torch.where(length > 0, length, torch.inf).rsqrt()


def transport(
    points: SurfacePoints,
    direction: Float[Tensor, "points directions 3"],
    weight: Float[Tensor, "points directions"],
) -> Float[Tensor, "points directions 3"]:
    """Factor on each direction's radiance, BRDF times cosine times ``weight`` (steradian); zero below the surface."""
    normal, outgoing = points.normal[:, None].expand_as(direction), points.outgoing[:, None].expand_as(direction)
    cosine = (normal * direction).sum(-1).clamp(min=0)
    lobe = specular(normal, outgoing, direction, points.roughness[:, None].expand_as(weight))
    return (diffuse(points.albedo)[:, None] + lobe[..., None]) * (cosine * weight)[..., None]
