"""Settings of R3DG: how much work a run does, how it learns materials and light, and what an ablation changes.

Defaults are those of its script for Synthetic4Relight where nothing else is said.
"""

from dataclasses import dataclass, field
from typing import Literal

from radiogs_core.errors import UsageError
from radiogs_core.learning.losses import ABSOLUTE_WEIGHT, SIMILARITY_WEIGHT
from radiogs_core.on_surfels.settings import GEOMETRY_PRESETS, SurfelBudget, SurfelVariant, by_name
from radiogs_core.on_surfels.start_values import StartValues


@dataclass(frozen=True, kw_only=True)
class Budget(SurfelBudget):
    """How much work a run may do."""

    shown_only = ("relight_samples",)

    incident_samples: int
    """Directions by which all surfels are shaded (S); visibility along them is traced before stage 2."""
    retraced_surfels: int
    """Surfels whose visibility is traced anew in a step, with ``Variant.visibility`` "retraced"."""
    local_rate: float
    """Factor of the rates of the local light: short runs take longer steps."""
    relight_samples: int
    """Directions of each surfel under another light."""


PRESETS = by_name(
    Budget(
        name="smoke",
        geometry=GEOMETRY_PRESETS["smoke"],
        inverse_iterations=20,
        incident_samples=8,
        retraced_surfels=64,
        local_rate=4.0,
        light_height=8,
        relight_samples=16,
    ),
    Budget(
        name="tiny",
        geometry=GEOMETRY_PRESETS["tiny"],
        inverse_iterations=600,
        incident_samples=32,
        retraced_surfels=256,
        local_rate=4.0,
        light_height=16,
        relight_samples=128,
    ),
    Budget(
        name="small",
        geometry=GEOMETRY_PRESETS["small"],
        inverse_iterations=3000,
        incident_samples=64,
        retraced_surfels=1024,
        local_rate=2.0,
        light_height=16,
        relight_samples=192,
    ),
    Budget(
        name="paper",
        geometry=GEOMETRY_PRESETS["paper"],
        inverse_iterations=20_000,
        incident_samples=64,
        retraced_surfels=4096,
        local_rate=1.0,
        light_height=16,
        relight_samples=384,
    ),
)


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
class MaterialStart(StartValues):
    """What materials and light start as; the local light starts at zero."""

    albedo: float = 0.415
    """Linear diffuse albedo of all channels under a constant light."""
    roughness: float = 0.54
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


LocalLight = Literal["free", "gated", "none"]
"""The light of a surfel's own harmonics: added as it is, multiplied by 1 - V, or zero."""

Visibility = Literal["table", "retraced"]
"""V along directions that are traced once; or, in training, traced anew along directions turned at random."""


@dataclass(frozen=True)
class Variant(SurfelVariant):
    """A variant of R3DG; the defaults are the full method."""

    shown_only = ("relight_local_light",)

    local_light: LocalLight = "free"
    """Local light in training (see ``LocalLight``); images and relit images have the same."""
    relight_local_light: bool = True
    """Whether relit images keep the local light, which was learnt under the light of training."""
    visibility: Visibility = "table"
    """Source of V in training (see ``Visibility``); images are always shown by a table."""
    hidden_below: float = 0.9
    """Transmittance below which a direction counts as hidden, in [0, 1]; 0.03 is nearly V = 1 - A."""
    floor: bool = False
    """Whether directions have the published heights, none below 10 degrees; otherwise their cosines sum exactly to pi
    (see ``sampling.hemisphere_directions``)."""
    ray_start: float | None = None
    """Distance from its surfel at which a ray starts, in the scene's extents (the script's 0.06 is 0.013 of
    Synthetic4Relight's). None: one standard deviation of the surfel."""
    two_sided: bool = True
    """Whether rays also hit surfels from behind, beyond four of those standard deviations."""
    materials: MaterialLearning = field(default_factory=MaterialLearning)
    """Weights, rates and starting values of stage 2."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.hidden_below <= 1:
            raise UsageError(f"hidden_below: {self.hidden_below} is not between 0 and 1")
        self.require("zero or above", "ray_start")
