"""Settings for learning materials and light: every weight, rate, share and initial value.

Defaults are the recipe ``recommended`` (``recipes``). Shares are shares of the stage's iterations.
``radiogs_core.learning.geometry`` has the settings for surfels.
"""

from dataclasses import dataclass, field
from typing import Literal

from radiogs_core.learning.losses import ABSOLUTE_WEIGHT, SIMILARITY_WEIGHT
from radiogs_core.on_surfels.settings import LengthRule
from radiogs_core.on_surfels.start_values import StartValues
from radiogs_core.plain_values import NotNegative, require


@dataclass(frozen=True)
class SplitSumLearning:
    """Settings of stage 1 for materials and light, which it learns by split-sum shading."""

    image: float = 0.1
    """Weight of the split sum's image loss; the image loss of the surfels' radiance has weight 1 (paper: both 1)."""
    geometry_gradient: bool = False
    """Whether the losses of the split sum have gradient to the surfels' positions, rotations, scales and opacities
    (paper: yes). Without it they have gradient to materials, light and the surfels' own radiance alone. The split sum
    has no shadows and no inter-reflection, and with this gradient it explains them by wrong shapes."""
    consistency: float = 0.2
    """Weight of the simplified radiometric consistency."""
    consistency_from: float = 2_000 / 40_000
    """Share of the stage from which on the consistency counts."""
    albedo_rate: float = 0.005
    """Learning rate of the albedo's logits."""
    roughness_rate: float = 0.005
    """Learning rate of the logits of roughness."""
    light_rate: float = 0.01
    """Learning rate of the light's log-radiance."""
    light: float = 1.0
    """Linear radiance of the constant initial light."""

    def __post_init__(self) -> None:
        require(self, "zero or above", "image", "consistency", "albedo_rate", "roughness_rate", "light_rate")
        require(self, "between 0 and 1", "consistency_from")
        require(self, "above zero", "light")


@dataclass(frozen=True)
class MaterialWeights(NotNegative):
    """Weights of the losses of stage 2 except L_rad (``Variant.radiometric_weight``); 0 leaves a loss out."""

    absolute: float = ABSOLUTE_WEIGHT
    """Weight of L1 between each blended image and the training image, in display sRGB (3DGS)."""
    similarity: float = SIMILARITY_WEIGHT
    """Weight of 1 - SSIM between these images (3DGS)."""
    squared: float = 10.0
    """Weight of the squared error between the image of L_PBR and the training image (paper: 0). L1 and SSIM hardly
    count the few bright pixels of a highlight, by which roughness is known."""
    normal: float = 0.05
    """Weight of the distance between the surfels' normals and the normals of the depth map (2DGS)."""
    distortion: float = 0.0
    """Weight of the depth distortion, in the unit of stage 1's (``GeometryWeights.distortion``)."""
    mask: float = 0.02
    """Weight of the cross-entropy between coverage and the mask."""
    normal_smoothness: float = 0.01
    """Weight of the edge-aware smoothness of normals: differences of neighbours, except at edges of the image."""
    albedo_smoothness: float = 1.0
    """Weight of the edge-aware smoothness of albedo: differences of neighbours, except at edges of the image."""
    roughness_smoothness: float = 0.1
    """Weight of the edge-aware smoothness of roughness: differences of neighbours, except at edges of the image."""
    light_prior: float = 0.01
    """Weight of the distance of the irradiance's channels from their mean: light is nearly white."""
    light_smoothness: float = 0.005
    """Weight of the squared differences of neighbouring texels' log-radiance."""


@dataclass(frozen=True)
class MaterialRates(NotNegative):
    """Adam's learning rates in stage 2; the rates of albedo and roughness are the paper's.

    A light that was searched for (``LightStart``) is held. Learnt in stage 2 it drifts, and albedo with it: after 3,000
    steps at a rate of 0.0005 albedo and relighting were worse than after 600 on most held-out scenes, but not with the
    light held.
    """

    albedo: float = 0.005
    """Rate of the albedo's logits."""
    roughness: float = 0.005
    """Rate of the logits of roughness."""
    light: float = 0.0
    """Rate of the log-radiance of a light that was searched for; 0 holds it."""
    constant_light: float = 0.01
    """Rate of the log-radiance of a light that starts constant (paper: 0.01)."""
    radiance: float = 0.005
    """Rate of the surfels' harmonics of degree 0."""
    radiance_rest: float = 0.0025 / 20
    """Rate of the harmonics of higher degrees, as in stage 1."""
    geometry: float = 0.01
    """Factor of stage 1's initial rates of geometry (``SurfelRates``): geometry is refined, not learnt again."""
    length_power: float = 0.0
    """Power of the length rule for the rates of albedo, light and harmonics (``on_surfels.settings``)."""
    roughness_length_power: float = 0.5
    """Power of the length rule for the rate of roughness, of which a step's gradient is mostly noise."""

    def factor(self, steps: int) -> float:
        """The length rule's factor of these rates in a stage 2 of so many steps; 1 at the paper's 20,000."""
        return LengthRule(whole=20_000, power=self.length_power).factor(steps)

    def roughness_in(self, steps: int) -> float:
        """The rate of roughness in a stage 2 of so many steps."""
        return self.roughness * LengthRule(whole=20_000, power=self.roughness_length_power).factor(steps)


@dataclass(frozen=True)
class MaterialStart(StartValues):
    """Initial materials and light of stage 2.

    The radiance of a constant light follows from the images' exposure, so that the recovered albedo does not depend on
    the exposure, or from the deviation ``start-light``. Pixels above the quantile ``brightest`` are highlights.
    """

    albedo: float = 0.3
    """Linear diffuse albedo of all channels, with a constant light."""
    roughness: float = 0.6
    """Perceptual roughness r."""


@dataclass(frozen=True)
class IncidentDirections:
    """The directions along which stage 2 gathers the light on a surfel."""

    from_light: float = 0.5
    """Share of the N_s directions of a set that is drawn from the light, weighted by the balance heuristic; the others
    are spread over the hemisphere (paper: all of them). Spread directions alone seldom meet a sun; then the light
    missing from L_PBR goes into the radiance of surrounding surfels, and into albedo."""
    sets: Literal[1, 2] = 2
    """Number of independent sets of N_s cached directions (paper: one). With two, each has an image of its own, and the
    residual of one image drives the other's gradient (``losses.crossed``): with one, the noise of its directions is
    minimised as well. L_rad traces N_s rays of each of its surfels in either case, for the sets in turn."""

    def __post_init__(self) -> None:
        require(self, "between 0 and 1", "from_light")


@dataclass(frozen=True)
class MaterialLearning:
    """Settings of stage 2 for materials and light."""

    weights: MaterialWeights = field(default_factory=MaterialWeights)
    """Weights of the losses."""
    rates: MaterialRates = field(default_factory=MaterialRates)
    """Learning rates."""
    start: MaterialStart = field(default_factory=MaterialStart)
    """Initial values of materials and light."""
    directions: IncidentDirections = field(default_factory=IncidentDirections)
    """The directions of a surfel's incident light."""
    consistent_roughness: bool = False
    """Whether L_rad has gradient to roughness (paper: yes). Harmonics of degree 3 cannot hold a narrow lobe, so that
    |L_G - L_PBR| is least at a roughness of .6 to .8, whatever the surface's."""
    normal_from: float = 1_000 / 20_000
    """Share of the stage from which on the loss between normals and depth map counts."""

    def __post_init__(self) -> None:
        require(self, "between 0 and 1", "normal_from")
