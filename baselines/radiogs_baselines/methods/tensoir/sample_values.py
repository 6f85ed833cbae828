"""Outputs of the networks at the samples of marched rays."""

from dataclasses import dataclass
from typing import Literal

from jaxtyping import Float
from torch import Tensor

from .field import Field
from .marching import Marched, Rays
from .shading import Materials


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
