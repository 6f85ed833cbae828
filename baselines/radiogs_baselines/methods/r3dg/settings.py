"""Settings of R3DG: how much work a run does, how it learns materials and light, and what an ablation changes.

Unless a field states otherwise, defaults are the published script's for Synthetic4Relight.
"""

from dataclasses import dataclass, field
from typing import Literal

from radiogs_core.errors import UsageError
from radiogs_core.learning.losses import ABSOLUTE_WEIGHT, SIMILARITY_WEIGHT
from radiogs_core.on_surfels.settings import MaterialLearning, SurfelBudget, SurfelVariant, presets
from radiogs_core.on_surfels.start_values import StartValues
from radiogs_core.plain_values import NotNegative, require


@dataclass(frozen=True, kw_only=True)
class Budget(SurfelBudget):
    """Computational effort of a run."""

    shown_only = ("relight_samples",)

    incident_samples: int
    """Directions from which each surfel is lit (S); visibility along them is traced before stage 2."""
    retraced_surfels: int
    """Surfels whose visibility is retraced in each step, for ``Variant.visibility`` "retraced"."""
    local_rate: float
    """Factor on the learning rates of the local light; short runs take longer steps."""
    relight_samples: int
    """Directions from which each surfel is lit in relit images."""


PRESETS = presets(
    Budget,
    inverse_iterations=(20, 600, 3000, 20_000),
    incident_samples=(8, 32, 64, 64),
    retraced_surfels=(64, 256, 1024, 4096),
    local_rate=(4.0, 4.0, 2.0, 1.0),
    light_height=(8, 16, 16, 16),
    relight_samples=(16, 128, 192, 384),
)


@dataclass(frozen=True)
class MaterialWeights(NotNegative):
    """Weights of the losses; 0 leaves one out."""

    absolute: float = ABSOLUTE_WEIGHT
    """Weight of L1 between the shaded image and the training image, display sRGB."""
    similarity: float = SIMILARITY_WEIGHT
    """Weight of 1 - SSIM between the shaded image and the training image."""
    albedo_smoothness: float = 1.0
    """Weight of the gradients of the albedo map in display sRGB, down-weighted at image edges."""
    roughness_smoothness: float = 0.5
    """Weight of the gradients of the roughness map, down-weighted at image edges."""
    irradiance_smoothness: float = 1.0
    """Weight of the gradients of the irradiance map in display sRGB, down-weighted at edges of the normal map."""
    light_prior: float = 0.01
    """Weight of the distance of the channels of each surfel's irradiance from their mean: prefers white light."""
    light_smoothness: float = 0.01
    """Weight of the squared differences of log-radiance between neighbouring texels."""


@dataclass(frozen=True)
class MaterialRates(NotNegative):
    """Adam's learning rates."""

    albedo: float = 0.01
    """Rate of the albedo's logits."""
    roughness: float = 0.01
    """Rate of the roughness' logits."""
    light: float = 0.1
    """Rate of the environment map's raw values, before softplus."""
    local: float = 0.001
    """Rate of the local light's harmonics of degree 0."""
    local_rest: float = 0.001 / 10
    """Rate of the local light's harmonics of higher degrees."""


LocalLight = Literal["free", "gated", "none"]
"""Local light of a surfel: unweighted, multiplied by 1 - V, or zero."""

Visibility = Literal["table", "retraced"]
"""Visibility in training: traced once along fixed directions, or retraced along randomly rotated directions."""


@dataclass(frozen=True)
class Variant(SurfelVariant):
    """A variant of R3DG; the defaults are the full method."""

    shown_only = ("relight_local_light",)

    local_light: LocalLight = "free"
    """Local light in training and in rendered images (see ``LocalLight``)."""
    relight_local_light: bool = True
    """Whether relit images keep the local light, although it was learnt under the training light."""
    visibility: Visibility = "table"
    """Visibility in training (see ``Visibility``); rendered images always use a table traced once."""
    hidden_below: float = 0.9
    """Transmittance below which V is set to 0, in [0, 1]; 0.03 is nearly V = 1 - A."""
    floor: bool = False
    """Whether directions have the published elevations, none below 10 degrees; otherwise their weighted cosines sum
    exactly to pi (see ``sampling.hemisphere_directions``)."""
    ray_start: float | None = None
    """Distance from its surfel at which a ray starts, in the scene's extents (the script's 0.06 is 0.013 of
    Synthetic4Relight's). None: one standard deviation of the surfel."""
    two_sided: bool = True
    """Whether rays also hit surfels from behind, beyond four standard deviations from their origin."""
    materials: MaterialLearning[MaterialWeights, MaterialRates, StartValues] = field(
        default=MaterialLearning(MaterialWeights(), MaterialRates(), StartValues(albedo=0.415, roughness=0.54))
    )
    """Weights, rates and starting values of stage 2."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.hidden_below <= 1:
            raise UsageError(f"hidden_below: {self.hidden_below} is not between 0 and 1")
        require(self, "zero or above", "ray_start")
