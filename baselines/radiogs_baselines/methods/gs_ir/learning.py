"""How GS-IR learns materials, light and irradiance: every weight, rate and starting value as data.

Defaults are those of its scripts for TensoIR's scenes where nothing else is said.
"""

from dataclasses import dataclass, field
from typing import Literal

from radiogs_core.learning.light_start_settings import LightStart


@dataclass(frozen=True)
class MaterialWeights:
    """Weights of the losses; 0 leaves one out."""

    shaded: float = 1.0
    """L1 between the shaded image and the training image, display sRGB."""
    smoothness: float = 1.0
    """Squared differences of neighbouring pixels' albedo, roughness and metalness, less at edges of the image."""
    prior: float = 0.001
    """Mean of 1 - roughness, and of the metalness: materials are rough and not metallic."""
    light_smoothness: float = 0.01
    """Squared differences of neighbouring texels' log-radiance."""


@dataclass(frozen=True)
class MaterialRates:
    """Adam's learning rates; all are the script's rate of opacities."""

    albedo: float = 0.05
    """Rate of the albedo's logits."""
    roughness: float = 0.05
    """Rate of the roughness' logits."""
    metallic: float = 0.05
    """Rate of the metalness' logits."""
    light: float = 0.05
    """Rate of the light's log-radiance."""
    irradiance: float = 0.05
    """Rate of the irradiance's harmonics."""


@dataclass(frozen=True)
class MaterialStart:
    """What materials and light start as; irradiance starts at zero."""

    light: Literal["least-variation", "constant"] = "least-variation"
    """The light under which albedo varies least, with the albedo that follows from it, which RadioGS starts with here,
    too; or a constant light and a constant albedo, as in GS-IR's own script."""
    search: LightStart = field(default_factory=LightStart)
    """How the light of least variation is found."""
    albedo: float = 0.731
    """Linear diffuse albedo of all channels under a constant light."""
    roughness: float = 0.742
    """Perceptual roughness r."""
    metallic: float = 0.731
    """Metalness, where there is one."""
    white: float = 0.8
    """Albedo of white paint. A constant light starts so that the brightest surfaces seen are that under it; the script
    draws texels between 0.25 and 0.75, whatever the images' exposure."""
    brightest: float = 0.98
    """Quantile of the covered pixels that counts as the brightest."""


@dataclass(frozen=True)
class MaterialLearning:
    """How stage 2 learns materials, light and irradiance."""

    weights: MaterialWeights = field(default_factory=MaterialWeights)
    """Weights of the losses."""
    rates: MaterialRates = field(default_factory=MaterialRates)
    """Learning rates."""
    start: MaterialStart = field(default_factory=MaterialStart)
    """What materials and light start as."""
