"""How R3DG learns materials and light: every weight, rate and starting value as data.

Defaults are those of its script for Synthetic4Relight where nothing else is said.
"""

from dataclasses import dataclass, field

from radiogs_core.learning.losses import ABSOLUTE_WEIGHT, SIMILARITY_WEIGHT

from ..material_start import LightAndPaint


@dataclass(frozen=True)
class MaterialWeights:
    """Weights of the losses; 0 leaves one out."""

    absolute: float = ABSOLUTE_WEIGHT
    """L1 between the shaded image and the training image, display sRGB."""
    similarity: float = SIMILARITY_WEIGHT
    """1 - SSIM between these two."""
    albedo_smoothness: float = 1.0
    """Slopes of the albedo, encoded for display, where the image has no edges."""
    roughness_smoothness: float = 0.5
    """Slopes of the roughness where the image has no edges."""
    irradiance_smoothness: float = 1.0
    """Slopes of the irradiance, encoded for display, where the normals have no edges."""
    light_prior: float = 0.01
    """Distance of the channels of every surfel's irradiance from their mean: light is nearly white."""
    light_smoothness: float = 0.01
    """Squared differences of neighbouring texels' log-radiance."""


@dataclass(frozen=True)
class MaterialRates:
    """Adam's learning rates."""

    albedo: float = 0.01
    """Rate of the albedo's logits."""
    roughness: float = 0.01
    """Rate of the roughness' logits."""
    light: float = 0.1
    """Rate of the environment map before its softplus."""
    local: float = 0.001
    """Rate of the local light's harmonics of degree 0."""
    local_rest: float = 0.001 / 10
    """Rate of its harmonics of higher degrees."""


@dataclass(frozen=True)
class MaterialStart(LightAndPaint):
    """What materials and light start as; the local light starts at zero."""

    albedo: float = 0.415
    """Linear diffuse albedo of all channels under a constant light."""
    roughness: float = 0.54
    """Perceptual roughness r."""


@dataclass(frozen=True)
class MaterialLearning:
    """How stage 2 learns materials and light."""

    weights: MaterialWeights = field(default_factory=MaterialWeights)
    """Weights of the losses."""
    rates: MaterialRates = field(default_factory=MaterialRates)
    """Learning rates."""
    start: MaterialStart = field(default_factory=MaterialStart)
    """What materials and light start as."""
