"""Settings of SVG-IR: how much work a run does, how it learns materials and light, and what an ablation changes.

Defaults are those of its script for TensoIR's scenes where nothing else is said; shares are of the stage's iterations.
"""

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from radiogs_core.errors import UsageError
from radiogs_core.learning.geometry import GeometryLearning

from ..material_start import LightAndPaint


@dataclass(frozen=True)
class Budget:
    """How much work a run may do.

    Stage 1, shared with other methods: see ``radiogs_core.learning.fit_geometry.GeometryBudget``. Stage 2:
    ``inverse_iterations`` steps from a table of ``incident_samples`` (S) rays a surfel; each asks so many random
    surfels for consistency (``consistency_surfels``; as many as there are at most). ``light_height`` is the height of
    the learnt environment map. Relighting traces ``relight_samples`` rays a surfel.
    """

    name: str
    initialise_iterations: int
    initial_surfels: int
    maximum_surfels: int
    densify_interval: int
    geometry_rate: float
    inverse_iterations: int
    incident_samples: int
    consistency_surfels: int
    light_height: int
    relight_samples: int


BUDGET_SHOWN_ONLY = ("relight_samples",)
"""Fields of ``Budget`` that training does not read."""

PRESETS = {
    preset.name: preset
    for preset in (
        Budget(
            name="smoke", initialise_iterations=60, initial_surfels=400, maximum_surfels=600, densify_interval=20,
            geometry_rate=12.0, inverse_iterations=20, incident_samples=8, consistency_surfels=64, light_height=8,
            relight_samples=8,
        ),
        Budget(
            name="tiny", initialise_iterations=2000, initial_surfels=6000, maximum_surfels=6000, densify_interval=100,
            geometry_rate=12.0, inverse_iterations=600, incident_samples=16, consistency_surfels=1024, light_height=16,
            relight_samples=64,
        ),
        Budget(
            name="small", initialise_iterations=5000, initial_surfels=20_000, maximum_surfels=50_000,
            densify_interval=200, geometry_rate=5.0, inverse_iterations=3000, incident_samples=32,
            consistency_surfels=8192, light_height=32, relight_samples=128,
        ),
        Budget(
            name="paper", initialise_iterations=40_000, initial_surfels=100_000, maximum_surfels=2_000_000,
            densify_interval=500, geometry_rate=1.0, inverse_iterations=20_000, incident_samples=64,
            consistency_surfels=2_000_000, light_height=64, relight_samples=384,
        ),
    )
}  # fmt: skip
"""Stage 1 and the size of the light are RadioGS's, so that both methods' rows have the same."""


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


Attributes = Literal["bilinear", "constant"]
"""Materials and normals of a surfel: bilinear between four vertices, or one for the whole surfel."""

SHOWN_ONLY = ("relight_indirect", "relight_rows")
"""Fields of ``Variant`` that training does not read."""


@dataclass(frozen=True)
class Variant:
    """A variant of SVG-IR; the defaults are the full method. Lengths are in the scene's extents.

    attributes: see ``Attributes``.
    vertex_distance: of the vertices from the surfel's axes, in its standard deviations.
    indirect: whether the kept radiance lights anything, in training and under the recovered light.
    hop: the longest way from a ray's origin, or from one hit, to the next (the script's 0.2 is 0.044 of TensoIR's);
    None: rays of full length.
    gap: the shortest way from one hit to the next (the script's 0.01 is 0.0022).
    ray_start: the shortest way to the first hit (the script's 0.042 is 0.0093); None: one standard deviation of the
    surfel that the ray leaves.
    opaque: transmittance below which a ray sees nothing of the light.
    radiance_limit: brightest kept radiance, linear. light_limit: brightest light that is looked up, linear.
    relight_indirect: whether relit images have indirect light.
    relight_rows: rows that a new light is reduced to; None: as many as it has.
    view_share: share of the training views that both stages may see, in (0, 1].
    geometry: weights, rates and schedule of stage 1. materials: those of stage 2.
    """

    attributes: Attributes = "bilinear"
    vertex_distance: float = 1.5
    indirect: bool = True
    hop: float | None = 0.044
    gap: float = 0.0022
    ray_start: float | None = None
    opaque: float = 0.2
    radiance_limit: float = 10.0
    light_limit: float = 64.0
    relight_indirect: bool = True
    relight_rows: int | None = 32
    view_share: float = 1.0
    geometry: GeometryLearning = field(default_factory=GeometryLearning)
    materials: MaterialLearning = field(default_factory=MaterialLearning)

    def __post_init__(self) -> None:
        for name in ("vertex_distance", "hop", "radiance_limit", "light_limit", "relight_rows"):
            value = getattr(self, name)
            if value is not None and value <= 0:
                raise UsageError(f"{name}: {value} is not above zero")
        for name in ("gap", "ray_start"):
            value = getattr(self, name)
            if value is not None and value < 0:
                raise UsageError(f"{name}: {value} is not zero or above")
        if not 0 <= self.opaque < 1:
            raise UsageError(f"opaque: {self.opaque} is not zero or above and below 1")
        if not 0 < self.view_share <= 1:
            raise UsageError(f"view_share: {self.view_share} is not above 0 and at most 1")

    @property
    def straight(self) -> bool:
        """Whether images are encoded for display by straight radiance (see ``splatting.displayed``)."""
        return self.geometry.encoding == "straight"

    @property
    def vertices(self) -> int:
        """Vertices of a surfel."""
        return 4 if self.attributes == "bilinear" else 1

    def of_training(self) -> dict[str, Any]:
        """The fields that decide the trained model, as plain values."""
        return {name: value for name, value in asdict(self).items() if name not in SHOWN_ONLY}
