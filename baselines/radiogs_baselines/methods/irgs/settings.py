"""Settings of IRGS: how much work a run does, how it learns materials and light, and what an ablation changes.

Unless a field states otherwise, defaults are the published scripts' for TensoIR's scenes; shares of the stage are
shares of its iterations.
"""

from dataclasses import dataclass
from typing import Literal

from radiogs_core.learning.losses import ABSOLUTE_WEIGHT, SIMILARITY_WEIGHT
from radiogs_core.on_surfels.settings import MaterialLearning, SurfelBudget, SurfelVariant, presets
from radiogs_core.on_surfels.start_values import StartValues
from radiogs_core.plain_values import NotNegative, require


@dataclass(frozen=True, kw_only=True)
class Budget(SurfelBudget):
    """Computational effort of a run."""

    shown_only = ("render_samples", "relight_hemisphere_samples", "relight_light_samples")

    pixels: int
    """Pixels of one view shaded in each step of stage 2."""
    incident_samples: int
    """Rays traced from each shaded pixel (N_s)."""
    render_samples: int
    """Rays traced from each pixel of an image under the recovered light."""
    relight_hemisphere_samples: int
    """Rays of each pixel of a relit image that are spread evenly over the hemisphere."""
    relight_light_samples: int
    """Rays of each pixel of a relit image whose directions are sampled in proportion to the light's radiance."""


PRESETS = presets(
    Budget,
    inverse_iterations=(20, 600, 3000, 20_000),
    pixels=(64, 256, 512, 1024),
    incident_samples=(8, 32, 64, 256),
    light_height=(8, 16, 32, 64),
    render_samples=(8, 64, 128, 512),
    relight_hemisphere_samples=(8, 64, 128, 512),
    relight_light_samples=(8, 64, 64, 256),
)


@dataclass(frozen=True)
class MaterialWeights(NotNegative):
    """Weights of the losses; 0 leaves one out. The last three act only on geometry (``Variant.lr_scale`` > 0)."""

    shaded: float = 1.0
    """Weight of L1 between the shaded pixels and the training image, display sRGB."""
    absolute: float = ABSOLUTE_WEIGHT
    """Weight of L1 between the image of the surfels' own radiance and the training image, display sRGB."""
    similarity: float = SIMILARITY_WEIGHT
    """Weight of 1 - SSIM between the image of the surfels' own radiance and the training image."""
    albedo_smoothness: float = 2.0
    """Weight of the gradients of the albedo map, down-weighted at image edges."""
    roughness_smoothness: float = 2.0
    """Weight of the gradients of the roughness map, down-weighted at image edges."""
    light_prior: float = 0.1
    """Weight of the distance of the direct light's channels from their mean at the shaded pixels: prefers white
    light."""
    light_smoothness: float = 0.0005
    """Weight of the squared differences of log-radiance between neighbouring texels."""
    normal: float = 0.05
    """Weight of the distance between the blended normals and the normals of the depth map."""
    mask: float = 0.01
    """Weight of the cross-entropy between coverage and the mask."""
    normal_smoothness: float = 0.01
    """Weight of the gradients of the normal map, down-weighted at image edges."""


@dataclass(frozen=True)
class MaterialRates(NotNegative):
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
class Learning(MaterialLearning[MaterialWeights, MaterialRates, StartValues]):
    """How stage 2 learns materials and light."""

    normal_from: float = 1_000 / 20_000
    """Share of the stage after which the normal loss is active, if geometry is learnt."""

    def __post_init__(self) -> None:
        require(self, "between 0 and 1", "normal_from")


Indirect = Literal["traced", "detached", "none"]
"""L_ind in training: traced with gradient to the hit surfels' harmonics, traced without gradient, or zero."""


@dataclass(frozen=True)
class Variant(SurfelVariant):
    """A variant of IRGS; the defaults are the full method."""

    shown_only = ("relight_indirect", "secondary_albedo")

    indirect: Indirect = "traced"
    """L_ind in training and in images under the recovered light (see ``Indirect``)."""
    relight_indirect: bool = True
    """Whether relit images have indirect light."""
    secondary_albedo: Literal["recovered", "scaled"] = "recovered"
    """Albedo of the surfaces that rays hit in relighting: the recovered albedo, as in IRGS's script, or the albedo
    after the protocol's scaling, which visible surfaces always have."""
    lr_scale: float = 0.0
    """Factor on stage 1's initial learning rates of geometry in stage 2. At 0, the value of all of IRGS's scripts,
    geometry is frozen."""
    ray_start: float | None = None
    """Distance from the shaded point at which rays start, in the scene's extents (the script's 0.05 is 0.011 of
    TensoIR's). None: one standard deviation of the pixel's surfels, blended like their albedo."""
    two_sided: bool = True
    """Whether rays also hit surfels from behind, beyond four standard deviations from the point."""
    materials: Learning = Learning(MaterialWeights(), MaterialRates(), StartValues(albedo=0.3, roughness=0.6))
    """Weights, rates and starting values of stage 2."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self, "zero or above", "lr_scale", "ray_start")
