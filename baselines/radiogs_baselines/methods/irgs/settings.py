"""Settings of IRGS: how much work a run does, how it learns materials and light, and what an ablation changes.

Defaults are those of its scripts for TensoIR's scenes where nothing else is said; shares are of the stage's iterations.
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
    ``inverse_iterations`` steps; each shades ``pixels`` pixels of one view by ``incident_samples`` rays (N_s).
    ``light_height`` is the height of the learnt environment map. Images under the recovered light take
    ``render_samples`` rays a pixel; relit ones so many spread over the hemisphere and drawn from the light.
    """

    name: str
    initialise_iterations: int
    initial_surfels: int
    maximum_surfels: int
    densify_interval: int
    geometry_rate: float
    inverse_iterations: int
    pixels: int
    incident_samples: int
    light_height: int
    render_samples: int
    relight_hemisphere_samples: int
    relight_light_samples: int


BUDGET_SHOWN_ONLY = ("render_samples", "relight_hemisphere_samples", "relight_light_samples")
"""Fields of ``Budget`` that training does not read."""

PRESETS = {
    preset.name: preset
    for preset in (
        Budget(
            name="smoke", initialise_iterations=60, initial_surfels=400, maximum_surfels=600, densify_interval=20,
            geometry_rate=12.0, inverse_iterations=20, pixels=64, incident_samples=8, light_height=8, render_samples=8,
            relight_hemisphere_samples=8, relight_light_samples=8,
        ),
        Budget(
            name="tiny", initialise_iterations=2000, initial_surfels=6000, maximum_surfels=6000, densify_interval=100,
            geometry_rate=12.0, inverse_iterations=600, pixels=256, incident_samples=32, light_height=16,
            render_samples=64, relight_hemisphere_samples=64, relight_light_samples=64,
        ),
        Budget(
            name="small", initialise_iterations=5000, initial_surfels=20_000, maximum_surfels=50_000,
            densify_interval=200, geometry_rate=5.0, inverse_iterations=3000, pixels=512, incident_samples=64,
            light_height=32, render_samples=128, relight_hemisphere_samples=128, relight_light_samples=64,
        ),
        Budget(
            name="paper", initialise_iterations=40_000, initial_surfels=100_000, maximum_surfels=2_000_000,
            densify_interval=500, geometry_rate=1.0, inverse_iterations=20_000, pixels=1024, incident_samples=256,
            light_height=64, render_samples=512, relight_hemisphere_samples=512, relight_light_samples=256,
        ),
    )
}  # fmt: skip
"""Stage 1 and the size of the light are RadioGS's, so that both methods' rows have the same."""


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


Indirect = Literal["traced", "detached", "none"]
"""L_ind in training: traced with gradient to the harmonics of the surfels that rays meet, without, or zero."""

SHOWN_ONLY = ("relight_indirect", "secondary_albedo")
"""Fields of ``Variant`` that training does not read."""


@dataclass(frozen=True)
class Variant:
    """A variant of IRGS; the defaults are the full method.

    indirect: see ``Indirect``. Images under the recovered light have what training had.
    relight_indirect: whether relit images have indirect light.
    secondary_albedo: whether relighting shades what rays meet with the albedo as it was recovered, as IRGS's script
    does, or multiplied by the factor that the seen surfaces' albedo is multiplied by.
    lr_scale: share of the learning rates of stage 1 at which geometry moves in stage 2; at 0, which all of IRGS's
    scripts have, it is frozen.
    ray_start: distance from the shaded point at which rays start, in the scene's extents (the script's 0.05 is 0.011 of
    TensoIR's); None: one standard deviation of the surfels that the pixel sees, blended like their albedo.
    two_sided: whether rays meet surfels from behind, too, beyond four of those standard deviations.
    view_share: share of the training views that both stages may see, in (0, 1].
    geometry: weights, rates and schedule of stage 1. materials: those of stage 2.
    """

    indirect: Indirect = "traced"
    relight_indirect: bool = True
    secondary_albedo: Literal["recovered", "scaled"] = "recovered"
    lr_scale: float = 0.0
    ray_start: float | None = None
    two_sided: bool = True
    view_share: float = 1.0
    geometry: GeometryLearning = field(default_factory=GeometryLearning)
    materials: MaterialLearning = field(default_factory=MaterialLearning)

    def __post_init__(self) -> None:
        if self.lr_scale < 0:
            raise UsageError(f"lr_scale: {self.lr_scale} is not zero or above")
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
