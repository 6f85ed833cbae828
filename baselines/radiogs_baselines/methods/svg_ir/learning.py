"""How SVG-IR learns materials and light: every weight, rate and starting value as data.

Defaults are those of its script for TensoIR's scenes where nothing else is said; shares are of the stage's iterations.
"""

from dataclasses import dataclass, field

from ..material_start import LightAndPaint


@dataclass(frozen=True)
class MaterialWeights:
    """Weights of the losses; 0 leaves one out."""

    shaded: float = 1.0
    """The shaded image against the training image, display sRGB: ``absolute`` L1 + ``similarity`` (1 - SSIM)."""
    radiance: float = 1.0
    """The image of the surfels' own radiance against it, the same way."""
    absolute: float = 0.9
    """L1 in both."""
    similarity: float = 0.1
    """1 - SSIM in both."""
    consistency: float = 0.05
    """L1 between what one bounce off the materials sends and the kept radiance times the ratio."""
    normal: float = 0.02
    """Distance between the vertices' normals and those of the depth map."""
    offset: float = 0.1
    """Mean square of the vertices' offsets from the surfel's normal."""
    albedo_smoothness: float = 0.1
    """Slopes of the albedo where the image has no edges."""
    roughness_smoothness: float = 0.05
    """Slopes of the roughness where the image has no edges."""
    light_smoothness: float = 0.02
    """Squared differences of neighbouring texels' log-radiance."""


@dataclass(frozen=True)
class MaterialRates:
    """Adam's learning rates."""

    albedo: float = 0.01
    """Rate of the vertices' albedo logits."""
    roughness: float = 0.01
    """Rate of the vertices' roughness logits."""
    offset: float = 0.001
    """Rate of the vertices' offsets from the surfel's normal."""
    light: float = 0.025
    """Rate of the light's log-radiance."""
    ratio: float = 0.01
    """Rate of the one factor on all kept radiance."""
    opacity: float = 0.005
    """Rate of the surfels' opacity logits."""
    radiance: float = 0.00025
    """Rate of the surfels' harmonics of degree 0."""
    radiance_rest: float = 0.00025 / 20
    """Rate of the harmonics of higher degrees."""


@dataclass(frozen=True)
class MaterialStart(LightAndPaint):
    """What materials and light start as."""

    albedo: float = 0.5
    """Linear diffuse albedo of all channels under a constant light."""
    roughness: float = 0.5
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
    ratio_until: float = 1_000 / 20_000
    """Share of the stage after which the factor on kept radiance is held."""
