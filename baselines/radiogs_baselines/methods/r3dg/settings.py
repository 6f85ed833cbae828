"""Settings of R3DG: how much work a run does, how it learns materials and light, and what an ablation changes.

Defaults are those of its script for Synthetic4Relight where nothing else is said.
"""

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from radiogs_core.errors import UsageError
from radiogs_core.learning.geometry import GeometryLearning
from radiogs_core.learning.losses import ABSOLUTE_WEIGHT, SIMILARITY_WEIGHT

from ..material_start import LightAndPaint


@dataclass(frozen=True)
class Budget:
    """How much work a run may do.

    Stage 1, shared with other methods: see ``radiogs_core.learning.fit_geometry.GeometryBudget``. Stage 2:
    ``inverse_iterations`` steps; each shades all surfels by ``incident_samples`` directions (S), along which visibility
    was traced before, or, with ``Variant.visibility`` "retraced", is traced anew at ``retraced_surfels`` surfels a
    step. ``local_rate`` multiplies the rates of the local light (short runs take longer steps). ``light_height`` is
    the height of the learnt environment map. ``relight_samples``: directions of each surfel under another light.
    """

    name: str
    initialise_iterations: int
    initial_surfels: int
    maximum_surfels: int
    densify_interval: int
    geometry_rate: float
    inverse_iterations: int
    incident_samples: int
    retraced_surfels: int
    local_rate: float
    light_height: int
    relight_samples: int


BUDGET_SHOWN_ONLY = ("relight_samples",)
"""Fields of ``Budget`` that training does not read."""

PRESETS = {
    preset.name: preset
    for preset in (
        Budget(
            name="smoke", initialise_iterations=60, initial_surfels=400, maximum_surfels=600, densify_interval=20,
            geometry_rate=12.0, inverse_iterations=20, incident_samples=8, retraced_surfels=64, local_rate=4.0,
            light_height=8, relight_samples=16,
        ),
        Budget(
            name="tiny", initialise_iterations=2000, initial_surfels=6000, maximum_surfels=6000, densify_interval=100,
            geometry_rate=12.0, inverse_iterations=600, incident_samples=32, retraced_surfels=256, local_rate=4.0,
            light_height=16, relight_samples=128,
        ),
        Budget(
            name="small", initialise_iterations=5000, initial_surfels=20_000, maximum_surfels=50_000,
            densify_interval=200, geometry_rate=5.0, inverse_iterations=3000, incident_samples=64,
            retraced_surfels=1024, local_rate=2.0, light_height=16, relight_samples=192,
        ),
        Budget(
            name="paper", initialise_iterations=40_000, initial_surfels=100_000, maximum_surfels=2_000_000,
            densify_interval=500, geometry_rate=1.0, inverse_iterations=20_000, incident_samples=64,
            retraced_surfels=4096, local_rate=1.0, light_height=16, relight_samples=384,
        ),
    )
}  # fmt: skip
"""Stage 1 is RadioGS's, so that both methods' rows have the same."""


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
class MaterialStart(LightAndPaint):
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

SHOWN_ONLY = ("relight_local_light",)
"""Fields of ``Variant`` that training does not read."""


@dataclass(frozen=True)
class Variant:
    """A variant of R3DG; the defaults are the full method.

    local_light: see ``LocalLight``; images and relit images have what training had.
    relight_local_light: whether relit images keep the local light, which was learnt under the light of training.
    visibility: see ``Visibility``. Images are always shown by a table.
    hidden_below: transmittance below which a direction counts as hidden, in [0, 1]; 0.03 is nearly V = 1 - A.
    floor: whether directions have the published heights, none below 10 degrees; otherwise those whose cosines sum
    exactly to pi (see ``sampling.hemisphere_directions``).
    ray_start: distance from its surfel at which a ray starts, in the scene's extents (the script's 0.06 is 0.013 of
    Synthetic4Relight's); None: one standard deviation of the surfel.
    two_sided: whether rays meet surfels from behind, too, beyond four of those standard deviations.
    view_share: share of the training views that both stages may see, in (0, 1].
    geometry: weights, rates and schedule of stage 1. materials: those of stage 2.
    """

    local_light: LocalLight = "free"
    relight_local_light: bool = True
    visibility: Visibility = "table"
    hidden_below: float = 0.9
    floor: bool = False
    ray_start: float | None = None
    two_sided: bool = True
    view_share: float = 1.0
    geometry: GeometryLearning = field(default_factory=GeometryLearning)
    materials: MaterialLearning = field(default_factory=MaterialLearning)

    def __post_init__(self) -> None:
        if not 0 <= self.hidden_below <= 1:
            raise UsageError(f"hidden_below: {self.hidden_below} is not between 0 and 1")
        if self.ray_start is not None and self.ray_start < 0:
            raise UsageError(f"ray_start: {self.ray_start} is not zero or above")
        if not 0 < self.view_share <= 1:
            raise UsageError(f"view_share: {self.view_share} is not above 0 and at most 1")

    @property
    def straight(self) -> bool:
        """Whether images are encoded for display by straight radiance (see ``splatting.displayed``)."""
        return self.geometry.encoding == "straight"

    def of_training(self) -> dict[str, Any]:
        """The fields that decide the trained model, as plain values."""
        return {name: value for name, value in asdict(self).items() if name not in SHOWN_ONLY}
