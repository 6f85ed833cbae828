"""What the networks say of the samples of marched rays."""

from dataclasses import dataclass
from typing import Literal

from jaxtyping import Float
from torch import Tensor

from .field import Field
from .marching import Marched, Rays
from .shading import Materials


@dataclass(frozen=True)
class Seen:
    """Values of the counted samples of ``marched``. radiance: linear, towards the ray's origin. albedo: linear.

    predicted, derived: normals of the network and of the density (see ``Field``).
    """

    marched: Marched
    radiance: Float[Tensor, "counted 3"]
    albedo: Float[Tensor, "counted 3"]
    roughness: Float[Tensor, " counted"]
    predicted: Float[Tensor, "counted 3"]
    derived: Float[Tensor, "counted 3"]

    def materials(self, normals: Literal["predicted", "derived"]) -> Materials:
        """Blended along each ray."""
        blended = self.marched.blended
        normal = self.predicted if normals == "predicted" else self.derived
        return Materials(blended(self.albedo), blended(self.roughness), blended(normal))


def seen_along(field: Field, rays: Rays, marched: Marched) -> Seen:
    """Ask all networks about the counted samples."""
    place = marched.places
    features = field.features(place)
    albedo, roughness = field.materials(features, place)
    return Seen(
        marched=marched,
        radiance=field.radiance(features, rays.direction[marched.ray]),
        albedo=albedo,
        roughness=roughness,
        predicted=field.predicted_normal(features, place),
        derived=field.derived_normal(place),
    )
