"""Settings of GI-GS: how much work a run does, how it learns materials and light, and what an ablation changes.

Defaults are those of its script, which are GS-IR's, where nothing else is said; shares are of the stage's iterations.
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

    Stage 1, shared with other methods: see ``radiogs_core.learning.fit_geometry.GeometryBudget``. Stage 2:
    ``inverse_iterations`` steps; each frame looks around from every pixel along the directions of a grid of
    ``azimuths`` by ``heights`` (see ``grid``), and at ``march_steps`` places a radius along each. ``light_height`` is
    the height of the learnt environment map. Frames that are shown have a grid of ``render_azimuths`` by
    ``render_heights``.
    """

    name: str
    initialise_iterations: int
    initial_surfels: int
    maximum_surfels: int
    densify_interval: int
    geometry_rate: float
    inverse_iterations: int
    azimuths: int
    heights: int
    march_steps: int
    light_height: int
    render_azimuths: int
    render_heights: int

    def __post_init__(self) -> None:
        for name in ("heights", "render_heights"):
            if getattr(self, name) < 3:
                raise UsageError(
                    f"{name}: {getattr(self, name)} is less than 3",
                    "The first one is the normal and the last one the horizon; neither counts.",
                )


BUDGET_SHOWN_ONLY = ("render_azimuths", "render_heights")
"""Fields of ``Budget`` that training does not read."""

PRESETS = {
    preset.name: preset
    for preset in (
        Budget(
            name="smoke", initialise_iterations=60, initial_surfels=400, maximum_surfels=600, densify_interval=20,
            geometry_rate=12.0, inverse_iterations=20, azimuths=8, heights=5, march_steps=8, light_height=8,
            render_azimuths=8, render_heights=5,
        ),
        Budget(
            name="tiny", initialise_iterations=2000, initial_surfels=6000, maximum_surfels=6000, densify_interval=100,
            geometry_rate=12.0, inverse_iterations=600, azimuths=8, heights=5, march_steps=16, light_height=16,
            render_azimuths=16, render_heights=9,
        ),
        Budget(
            name="small", initialise_iterations=5000, initial_surfels=20_000, maximum_surfels=50_000,
            densify_interval=200, geometry_rate=5.0, inverse_iterations=3000, azimuths=16, heights=9, march_steps=16,
            light_height=32, render_azimuths=32, render_heights=17,
        ),
        Budget(
            name="paper", initialise_iterations=40_000, initial_surfels=100_000, maximum_surfels=2_000_000,
            densify_interval=500, geometry_rate=1.0, inverse_iterations=5000, azimuths=32, heights=17, march_steps=16,
            light_height=64, render_azimuths=32, render_heights=17,
        ),
    )
}  # fmt: skip
"""Stage 1 and the size of the light are RadioGS's, so that both methods' rows have the same."""


@dataclass(frozen=True)
class MaterialWeights:
    """Weights of the losses; 0 leaves one out."""

    shaded: float = 1.0
    """L1 between the shaded image and the training image, display sRGB."""
    variation: float = 1.0
    """Squared differences of neighbouring pixels' albedo, roughness and metallic."""
    plainness: float = 0.001
    """Distance of roughness from 1 and of metallic from 0."""
    light_smoothness: float = 0.01
    """Squared differences of neighbouring texels' log-radiance."""


@dataclass(frozen=True)
class MaterialRates:
    """Adam's learning rates."""

    albedo: float = 0.05
    """Rate of the albedo's logits at the start."""
    albedo_end: float = 0.05 * 10**-0.5
    """The same at the end, geometric in between: the script falls to a tenth in 10,000 steps and stops after 5,000."""
    roughness: float = 0.05
    """Rate of the roughness' logits."""
    metallic: float = 0.05
    """Rate of the metallic's logits."""
    light: float = 0.05
    """Rate of the light's log-radiance."""


@dataclass(frozen=True)
class MaterialStart(LightAndPaint):
    """What materials and light start as."""

    albedo: float = 0.73
    """Linear diffuse albedo of all channels under a constant light."""
    roughness: float = 0.73
    """Perceptual roughness r."""
    metallic: float = 0.73
    """Share of metal, where it is learnt."""


@dataclass(frozen=True)
class MaterialLearning:
    """How stage 2 learns materials and light."""

    weights: MaterialWeights = field(default_factory=MaterialWeights)
    """Weights of the losses."""
    rates: MaterialRates = field(default_factory=MaterialRates)
    """Learning rates."""
    start: MaterialStart = field(default_factory=MaterialStart)
    """What materials and light start as."""


Sum = Literal["display", "linear"]
"""Where direct and indirect light are added up: as display sRGB, each encoded by itself, or as linear radiance."""

WHOLE_MARCH = 16
"""Steps in a radius that ``Variant.start`` counts in: those of the published script."""

README_START = 64
"""First step of the march in the published README's command for training; beyond the last one."""

SHOWN_ONLY = ("relight_indirect", "frame")
"""Fields of ``Variant`` that training does not read."""


@dataclass(frozen=True)
class Variant:
    """A variant of GI-GS; the defaults are the full method. Lengths are in the scene's extents.

    indirect: whether training, and images under the recovered light, have the bounce that is gathered on the screen.
    relight_indirect: whether relit images have it.
    occlusion: whether training, and images under the recovered light, have the occlusion found on the screen.
    sum: see ``Sum``. frame: see ``Frame``.
    metallic: whether a share of metal is learnt for each surfel: it colours the lobe by the albedo, and what is metal
    sends no bounce.
    start: first step of each march, in sixteenths of the radius; nearer surfaces are not met. From 16 on nothing is.
    readme_bug: whether training marches from ``README_START`` on, as the published README's command says: it then finds
    nothing, but images are shown with what ``start`` finds.
    radius, bias, thick: length of a march; how far behind the marched point, and how far before it, a surface counts as
    met. The script's 0.8, 0.01 and 0.05 are so many of TensoIR's extents.
    far: depth over which the radius grows: it is multiplied by (1 + depth / far)^2. The script's is 100.
    lr_scale: share of the learning rates that stage 1 ends with at which geometry moves in stage 2, through the
    blending of the maps alone; at 0 it is frozen.
    view_share: share of the training views that both stages may see, in (0, 1].
    geometry: weights, rates and schedule of stage 1. materials: those of stage 2.
    """

    indirect: bool = True
    relight_indirect: bool = True
    occlusion: bool = True
    sum: Sum = "display"
    frame: Frame = "oriented"
    metallic: bool = False
    start: int = 8
    readme_bug: bool = False
    radius: float = 0.176
    bias: float = 0.0022
    thick: float = 0.011
    far: float = 22.0
    lr_scale: float = 1.0
    view_share: float = 1.0
    geometry: GeometryLearning = field(default_factory=GeometryLearning)
    materials: MaterialLearning = field(default_factory=MaterialLearning)

    def __post_init__(self) -> None:
        for name in ("start", "bias", "thick", "lr_scale"):
            if getattr(self, name) < 0:
                raise UsageError(f"{name}: {getattr(self, name)} is not zero or above")
        for name in ("radius", "far"):
            if not getattr(self, name) > 0:
                raise UsageError(f"{name}: {getattr(self, name)} is not above zero")
        if not 0 < self.view_share <= 1:
            raise UsageError(f"view_share: {self.view_share} is not above 0 and at most 1")

    @property
    def training_start(self) -> int:
        """First step of each march in training."""
        return README_START if self.readme_bug else self.start

    @property
    def straight(self) -> bool:
        """Whether images are encoded for display by straight radiance (see ``splatting.displayed``)."""
        return self.geometry.encoding == "straight"

    def of_training(self) -> dict[str, Any]:
        """The fields that decide the trained model, as plain values."""
        return {name: value for name, value in asdict(self).items() if name not in SHOWN_ONLY}
