"""How IRGS learns materials and light: every weight, rate and starting value as data.

Defaults are those of its scripts for TensoIR's scenes where nothing else is said; shares are of the stage's iterations.
"""

from dataclasses import dataclass, field

from radiogs_core.learning.losses import ABSOLUTE_WEIGHT, SIMILARITY_WEIGHT

from ..material_start import LightAndPaint


@dataclass(frozen=True)
class MaterialWeights:
    """Weights of the losses; 0 leaves one out. The last three act on geometry alone: only where it is learnt."""

    shaded: float = 1.0
    """L1 between the shaded pixels and the training image, display sRGB."""
    absolute: float = ABSOLUTE_WEIGHT
    """L1 between the image of the surfels' own radiance and the training image, display sRGB."""
    similarity: float = SIMILARITY_WEIGHT
    """1 - SSIM between these two."""
    albedo_smoothness: float = 2.0
    """Slopes of the albedo where the image has no edges."""
    roughness_smoothness: float = 2.0
    """Slopes of the roughness where the image has no edges."""
    light_prior: float = 0.1
    """Distance of the direct light's channels from their mean at the shaded pixels: light is nearly white."""
    light_smoothness: float = 0.0005
    """Squared differences of neighbouring texels' log-radiance."""
    normal: float = 0.05
    """Distance between the surfels' normals and those of the depth map."""
    mask: float = 0.01
    """Cross-entropy between coverage and the mask."""
    normal_smoothness: float = 0.01
    """Slopes of the normals where the image has no edges."""


@dataclass(frozen=True)
class MaterialRates:
    """Adam's learning rates."""

    albedo: float = 0.0075
    """Rate of the albedo's logits."""
    roughness: float = 0.005
    """Rate of the roughness' logits."""
    light: float = 0.01
    """Rate of the light's log-radiance."""
    radiance: float = 0.0075
    """Rate of the surfels' harmonics of degree 0."""
    radiance_rest: float = 0.0075 / 20
    """Rate of the harmonics of higher degrees."""


@dataclass(frozen=True)
class MaterialStart(LightAndPaint):
    """What materials and light start as."""

    albedo: float = 0.3
    """Linear diffuse albedo of all channels under a constant light."""
    roughness: float = 0.6
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
    normal_from: float = 1_000 / 20_000
    """Share of the stage after which normals are held to the depth map, where geometry is learnt."""
