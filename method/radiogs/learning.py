"""How RadioGS learns materials and light: every weight, rate, share and starting value as data.

Defaults are the paper's where nothing else is said. Shares are of the stage's iterations (see
``radiogs_core.learning.geometry``, which has those of surfels).
"""

from dataclasses import dataclass, field

from radiogs_core.learning.losses import ABSOLUTE_WEIGHT, SIMILARITY_WEIGHT
from radiogs_core.on_surfels.start_values import StartValues


@dataclass(frozen=True)
class SplitSumLearning:
    """How stage 1 learns materials and light, by split-sum shading."""

    image: float = 0.1
    """Weight of the image loss of the split sum, beside that of the surfels' radiance (paper: 1)."""
    geometry_gradient: bool = False
    """Whether the losses of the split sum have gradient to the surfels' places, rotations, scales and opacities, too
    (paper), or to materials, light and the surfels' own radiance alone. Its light has no shadows and no
    inter-reflection, which it explains by wrong shapes where it may."""
    consistency: float = 0.2
    """Weight of the simplified radiometric consistency."""
    consistency_from: float = 2_000 / 40_000
    """Share of the stage after which it counts."""
    albedo_rate: float = 0.005
    """Learning rate of the albedo's logits."""
    roughness_rate: float = 0.005
    """Learning rate of the roughness' logits."""
    light_rate: float = 0.01
    """Learning rate of the light's log-radiance."""
    light: float = 1.0
    """Constant linear radiance that the light starts with."""


@dataclass(frozen=True)
class MaterialWeights:
    """Weights of the losses of stage 2, beside ``Variant.radiometric_weight``; 0 leaves one out."""

    absolute: float = ABSOLUTE_WEIGHT
    """L1 between each blended image and the training image, in display sRGB (3DGS)."""
    similarity: float = SIMILARITY_WEIGHT
    """1 - SSIM between these images (3DGS)."""
    normal: float = 0.05
    """Distance between the surfels' normals and those of the depth map (2DGS)."""
    mask: float = 0.02
    """Cross-entropy between coverage and the mask."""
    normal_smoothness: float = 0.01
    """Slopes of the normals where the image has no edges."""
    albedo_smoothness: float = 1.0
    """Slopes of the albedo where the image has no edges."""
    roughness_smoothness: float = 0.1
    """Slopes of the roughness where the image has no edges."""
    light_prior: float = 0.01
    """Distance of the diffuse light's channels from their mean: light is nearly white."""
    light_smoothness: float = 0.005
    """Squared differences of neighbouring texels' log-radiance."""


@dataclass(frozen=True)
class MaterialRates:
    """Adam's learning rates in stage 2. Albedo and roughness: the paper's.

    The light, once found (``LightStart``), learns slowly. What single surfels receive is noisier than what pixels see
    of them, and a faster light takes that noise in: on ``corner`` its error rises from 0.36 to 0.61 in 800 steps at a
    rate of 0.002 and to 0.44 at 0.0005. From a constant light the paper's 0.01 finds no sun either.
    """

    albedo: float = 0.005
    """Rate of the albedo's logits."""
    roughness: float = 0.005
    """Rate of the roughness' logits."""
    light: float = 0.0005
    """Rate of the light's log-radiance (paper: 0.01)."""
    radiance: float = 0.005
    """Rate of the surfels' harmonics of degree 0."""
    radiance_rest: float = 0.0025 / 20
    """Rate of the harmonics of higher degrees, as in stage 1."""
    geometry: float = 0.01
    """Share of the rates of stage 1 (``SurfelRates``, positions at the beginning) at which geometry moves: it is
    refined, not learnt again."""


@dataclass(frozen=True)
class MaterialStart(StartValues):
    """What materials and light start as in stage 2.

    A constant light starts by the images' exposure, so that neither the released constant radiance of 1.5 nor the
    recovered albedo depends on it; above ``brightest`` highlights begin.
    """

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
    """Share of the stage after which the normals are held to the depth map again."""
