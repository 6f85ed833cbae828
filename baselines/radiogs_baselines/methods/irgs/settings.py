"""Settings of IRGS: how much work a run does, how it learns materials and light, and what an ablation changes.

Defaults are those of its scripts for TensoIR's scenes where nothing else is said; shares are of the stage's iterations.
"""

from dataclasses import dataclass, field
from typing import Literal

from radiogs_core.learning.losses import ABSOLUTE_WEIGHT, SIMILARITY_WEIGHT
from radiogs_core.on_surfels.settings import GEOMETRY_PRESETS, SurfelBudget, SurfelVariant, by_name
from radiogs_core.on_surfels.start_values import StartValues


@dataclass(frozen=True, kw_only=True)
class Budget(SurfelBudget):
    """How much work a run may do."""

    shown_only = ("render_samples", "relight_hemisphere_samples", "relight_light_samples")

    pixels: int
    """Pixels of one view that a step of stage 2 shades."""
    incident_samples: int
    """Rays of each shaded pixel (N_s)."""
    render_samples: int
    """Rays of each pixel of an image under the recovered light."""
    relight_hemisphere_samples: int
    """Rays of each pixel of a relit image that are spread over the hemisphere."""
    relight_light_samples: int
    """Rays of each pixel of a relit image that are drawn from the light."""


PRESETS = by_name(
    Budget(
        name="smoke",
        geometry=GEOMETRY_PRESETS["smoke"],
        inverse_iterations=20,
        pixels=64,
        incident_samples=8,
        light_height=8,
        render_samples=8,
        relight_hemisphere_samples=8,
        relight_light_samples=8,
    ),
    Budget(
        name="tiny",
        geometry=GEOMETRY_PRESETS["tiny"],
        inverse_iterations=600,
        pixels=256,
        incident_samples=32,
        light_height=16,
        render_samples=64,
        relight_hemisphere_samples=64,
        relight_light_samples=64,
    ),
    Budget(
        name="small",
        geometry=GEOMETRY_PRESETS["small"],
        inverse_iterations=3000,
        pixels=512,
        incident_samples=64,
        light_height=32,
        render_samples=128,
        relight_hemisphere_samples=128,
        relight_light_samples=64,
    ),
    Budget(
        name="paper",
        geometry=GEOMETRY_PRESETS["paper"],
        inverse_iterations=20_000,
        pixels=1024,
        incident_samples=256,
        light_height=64,
        render_samples=512,
        relight_hemisphere_samples=512,
        relight_light_samples=256,
    ),
)


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
class MaterialStart(StartValues):
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


Indirect = Literal["traced", "detached", "none"]
"""L_ind in training: traced with gradient to the harmonics of the surfels that rays meet, without, or zero."""


@dataclass(frozen=True)
class Variant(SurfelVariant):
    """A variant of IRGS; the defaults are the full method."""

    shown_only = ("relight_indirect", "secondary_albedo")

    indirect: Indirect = "traced"
    """L_ind in training (see ``Indirect``); images under the recovered light have the same."""
    relight_indirect: bool = True
    """Whether relit images have indirect light."""
    secondary_albedo: Literal["recovered", "scaled"] = "recovered"
    """Albedo by which relighting shades the surfaces that rays hit: as it was recovered, as IRGS's script does, or
    multiplied by the factor of the visible surfaces' albedo."""
    lr_scale: float = 0.0
    """Share of the learning rates of stage 1 at which geometry moves in stage 2. At 0, the value of all of IRGS's
    scripts, geometry is frozen."""
    ray_start: float | None = None
    """Distance from the shaded point at which rays start, in the scene's extents (the script's 0.05 is 0.011 of
    TensoIR's). None: one standard deviation of the surfels that the pixel sees, blended like their albedo."""
    two_sided: bool = True
    """Whether rays also hit surfels from behind, beyond four of those standard deviations."""
    materials: MaterialLearning = field(default_factory=MaterialLearning)
    """Weights, rates and starting values of stage 2."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require("zero or above", "lr_scale", "ray_start")
