"""How R3DG learns materials and light: every weight, rate and starting value as data.

Defaults are those of its script for Synthetic4Relight where nothing else is said.
"""

from dataclasses import dataclass, field
from typing import Literal

from radiogs_core.learning.light_start_settings import LightStart
from radiogs_core.learning.losses import ABSOLUTE_WEIGHT, SIMILARITY_WEIGHT


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
class MaterialStart:
    """What materials and light start as; the local light starts at zero."""

    light: Literal["least-variation", "constant"] = "least-variation"
    """The light under which albedo varies least, with the albedo that follows from it, which RadioGS starts with here,
    too; or a constant light and a constant albedo, as in R3DG's own script."""
    search: LightStart = field(default_factory=LightStart)
    """How the light of least variation is found."""
    albedo: float = 0.415
    """Linear diffuse albedo of all channels under a constant light."""
    roughness: float = 0.54
    """Perceptual roughness r."""
    white: float = 0.8
    """Albedo of white paint. A constant light starts so that the brightest surfaces seen are that under it; the script
    draws texels between 0.69 and 0.97, whatever the images' exposure."""
    brightest: float = 0.98
    """Quantile of the covered pixels that counts as the brightest."""


@dataclass(frozen=True)
class MaterialLearning:
    """How stage 2 learns materials and light."""

    weights: MaterialWeights = field(default_factory=MaterialWeights)
    """Weights of the losses."""
    rates: MaterialRates = field(default_factory=MaterialRates)
    """Learning rates."""
    start: MaterialStart = field(default_factory=MaterialStart)
    """What materials and light start as."""
