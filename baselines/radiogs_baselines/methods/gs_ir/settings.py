"""Settings of GS-IR: how much work a run does, how it learns materials and light, and what an ablation changes.

Defaults are those of its scripts for TensoIR's scenes where nothing else is said.
"""

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from radiogs_core.errors import UsageError
from radiogs_core.learning.geometry import GeometryLearning

from ..material_start import LightAndPaint
from ..split_sum import Frame


@dataclass(frozen=True)
class Budget:
    """How much work a run may do.

    Stage 1, shared with other methods: see ``radiogs_core.learning.fit_geometry.GeometryBudget``. Between the stages
    occlusion is baked on a lattice of ``occlusion_corners`` corners an edge by ``occlusion_directions`` rays from each
    corner near a surface. Stage 2: ``inverse_iterations`` steps, of all pixels of one view; the occlusion of each is a
    mean over ``occlusion_samples`` directions. ``irradiance_corners``: corners an edge of the volume of indirect
    irradiance. ``light_height``: height of the learnt environment map.
    """

    name: str
    initialise_iterations: int
    initial_surfels: int
    maximum_surfels: int
    densify_interval: int
    geometry_rate: float
    inverse_iterations: int
    occlusion_corners: int
    occlusion_directions: int
    occlusion_samples: int
    irradiance_corners: int
    light_height: int


PRESETS = {
    preset.name: preset
    for preset in (
        Budget(
            name="smoke", initialise_iterations=60, initial_surfels=400, maximum_surfels=600, densify_interval=20,
            geometry_rate=12.0, inverse_iterations=20, occlusion_corners=8, occlusion_directions=64,
            occlusion_samples=16, irradiance_corners=6, light_height=8,
        ),
        Budget(
            name="tiny", initialise_iterations=2000, initial_surfels=6000, maximum_surfels=6000, densify_interval=100,
            geometry_rate=12.0, inverse_iterations=600, occlusion_corners=32, occlusion_directions=256,
            occlusion_samples=32, irradiance_corners=32, light_height=16,
        ),
        Budget(
            name="small", initialise_iterations=5000, initial_surfels=20_000, maximum_surfels=50_000,
            densify_interval=200, geometry_rate=5.0, inverse_iterations=2500, occlusion_corners=64,
            occlusion_directions=1024, occlusion_samples=128, irradiance_corners=32, light_height=32,
        ),
        Budget(
            name="paper", initialise_iterations=40_000, initial_surfels=100_000, maximum_surfels=2_000_000,
            densify_interval=500, geometry_rate=1.0, inverse_iterations=5000, occlusion_corners=128,
            occlusion_directions=4096, occlusion_samples=256, irradiance_corners=64, light_height=32,
        ),
    )
}  # fmt: skip
"""Stage 1 is RadioGS's, so that both methods' rows have the same."""


@dataclass(frozen=True)
class MaterialWeights:
    """Weights of the losses; 0 leaves one out."""

    shaded: float = 1.0
    """L1 between the shaded image and the training image, display sRGB."""
    smoothness: float = 1.0
    """Squared differences of neighbouring pixels' albedo, roughness and metalness, less at edges of the image."""
    prior: float = 0.001
    """Mean of 1 - roughness, and of the metalness: materials are rough and not metallic."""
    light_smoothness: float = 0.01
    """Squared differences of neighbouring texels' log-radiance."""


@dataclass(frozen=True)
class MaterialRates:
    """Adam's learning rates; all are the script's rate of opacities."""

    albedo: float = 0.05
    """Rate of the albedo's logits."""
    roughness: float = 0.05
    """Rate of the roughness' logits."""
    metallic: float = 0.05
    """Rate of the metalness' logits."""
    light: float = 0.05
    """Rate of the light's log-radiance."""
    irradiance: float = 0.05
    """Rate of the irradiance's harmonics."""


@dataclass(frozen=True)
class MaterialStart(LightAndPaint):
    """What materials and light start as; irradiance starts at zero."""

    albedo: float = 0.731
    """Linear diffuse albedo of all channels under a constant light."""
    roughness: float = 0.742
    """Perceptual roughness r."""
    metallic: float = 0.731
    """Metalness, where there is one."""


@dataclass(frozen=True)
class MaterialLearning:
    """How stage 2 learns materials, light and irradiance."""

    weights: MaterialWeights = field(default_factory=MaterialWeights)
    """Weights of the losses."""
    rates: MaterialRates = field(default_factory=MaterialRates)
    """Learning rates."""
    start: MaterialStart = field(default_factory=MaterialStart)
    """What materials and light start as."""


TexelAreas = Literal["exact", "approximate"]
"""Solid angles of texels in the diffuse pre-filter: as they are, or those of GS-IR's code, 8 % too large."""

SHOWN_ONLY = ("frame",)
"""Fields of ``Variant`` that training does not read."""


@dataclass(frozen=True)
class Variant:
    """A variant of GS-IR; the defaults are the full method. Lengths are in the scene's extents.

    occlusion: whether the diffuse part is occluded, O L_env + (1 - O) L_ind; otherwise O = 1.
    indirect: whether a volume of irradiance is learnt; otherwise L_ind = 0. Without occlusion there is none, either.
    tau: distance from which on geometry does not occlude (the script's 0.25 is 0.055 of TensoIR's); None: no end.
    nearest: distance up to which geometry does not occlude; the published rasterizer leaves out what is nearer than
    0.2, which is 0.044 of TensoIR's.
    metallic: whether a metalness is learnt that mixes F0 from 0.04 and the albedo.
    texel_areas: see ``TexelAreas``. frame: see ``Frame``.
    lr_scale: share of the rates that stage 1 ends with at which geometry moves in stage 2; at 0 it is frozen.
    view_share: share of the training views that both stages may see, in (0, 1].
    geometry: weights, rates and schedule of stage 1. materials: those of stage 2.
    """

    occlusion: bool = True
    indirect: bool = True
    tau: float | None = 0.055
    nearest: float = 0.0
    metallic: bool = False
    texel_areas: TexelAreas = "exact"
    frame: Frame = "oriented"
    lr_scale: float = 1.0
    view_share: float = 1.0
    geometry: GeometryLearning = field(default_factory=GeometryLearning)
    materials: MaterialLearning = field(default_factory=MaterialLearning)

    def __post_init__(self) -> None:
        if self.tau is not None and self.tau <= 0:
            raise UsageError(f"tau: {self.tau} is not above zero")
        for name in ("nearest", "lr_scale"):
            if getattr(self, name) < 0:
                raise UsageError(f"{name}: {getattr(self, name)} is not zero or above")
        if not 0 < self.view_share <= 1:
            raise UsageError(f"view_share: {self.view_share} is not above 0 and at most 1")

    @property
    def straight(self) -> bool:
        """Whether images are encoded for display by straight radiance (see ``splatting.displayed``)."""
        return self.geometry.encoding == "straight"

    def of_training(self) -> dict[str, Any]:
        """The fields that decide the trained model, as plain values."""
        return {name: value for name, value in asdict(self).items() if name not in SHOWN_ONLY}
