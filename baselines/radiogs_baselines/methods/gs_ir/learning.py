"""How GS-IR learns materials, light and irradiance: every weight, rate and starting value as data.

Defaults are those of its scripts for TensoIR's scenes where nothing else is said.
"""

from dataclasses import dataclass, field

from ..material_start import LightAndPaint


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
class MaterialStart(LightAndPaint):
    """What materials and light start as; irradiance starts at zero."""

    albedo: float = 0.731
    """Linear diffuse albedo of all channels under a constant light."""
    roughness: float = 0.742
    """Perceptual roughness r."""
    metallic: float = 0.731
    """Metalness, where there is one."""


@dataclass(frozen=True)
class MaterialLearning:
    """How stage 2 learns materials, light and irradiance."""

    weights: MaterialWeights = field(default_factory=MaterialWeights)
    """Weights of the losses."""
    rates: MaterialRates = field(default_factory=MaterialRates)
    """Learning rates."""
    start: MaterialStart = field(default_factory=MaterialStart)
    """What materials and light start as."""
