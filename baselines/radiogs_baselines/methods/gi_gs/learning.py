"""How GI-GS learns materials and light: every weight, rate and starting value as data.

Defaults are those of its script, which are GS-IR's, where nothing else is said; shares are of the stage's iterations.
"""

from dataclasses import dataclass, field

from ..material_start import LightAndPaint


@dataclass(frozen=True)
class MaterialWeights:
    """Weights of the losses; 0 leaves one out."""

    shaded: float = 1.0
    """L1 between the shaded image and the training image, display sRGB."""
    variation: float = 1.0
    """Squared differences of neighbouring pixels' albedo, roughness and metallic."""
    plainness: float = 0.001
    """Distance of roughness from 1 and of metallic from 0."""
    light_smoothness: float = 0.01
    """Squared differences of neighbouring texels' log-radiance."""


@dataclass(frozen=True)
class MaterialRates:
    """Adam's learning rates."""

    albedo: float = 0.05
    """Rate of the albedo's logits at the start."""
    albedo_end: float = 0.05 * 10**-0.5
    """The same at the end, geometric in between: the script falls to a tenth in 10,000 steps and stops after 5,000."""
    roughness: float = 0.05
    """Rate of the roughness' logits."""
    metallic: float = 0.05
    """Rate of the metallic's logits."""
    light: float = 0.05
    """Rate of the light's log-radiance."""


@dataclass(frozen=True)
class MaterialStart(LightAndPaint):
    """What materials and light start as."""

    albedo: float = 0.73
    """Linear diffuse albedo of all channels under a constant light."""
    roughness: float = 0.73
    """Perceptual roughness r."""
    metallic: float = 0.73
    """Share of metal, where it is learnt."""


@dataclass(frozen=True)
class MaterialLearning:
    """How stage 2 learns materials and light."""

    weights: MaterialWeights = field(default_factory=MaterialWeights)
    """Weights of the losses."""
    rates: MaterialRates = field(default_factory=MaterialRates)
    """Learning rates."""
    start: MaterialStart = field(default_factory=MaterialStart)
    """What materials and light start as."""
