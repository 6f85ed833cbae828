"""Settings of GI-GS: how much work a run does, how it learns materials and light, and what an ablation changes.

Defaults are those of its script, which are GS-IR's, where nothing else is said; shares are of the stage's iterations.
"""

from dataclasses import dataclass, field
from typing import Literal

from radiogs_core.errors import UsageError
from radiogs_core.on_surfels.settings import GEOMETRY_PRESETS, SurfelBudget, SurfelVariant, by_name
from radiogs_core.on_surfels.split_sum import Frame
from radiogs_core.on_surfels.start_values import StartValues


@dataclass(frozen=True, kw_only=True)
class Budget(SurfelBudget):
    """How much work a run may do. Every frame gathers light from every pixel along a grid of directions (``grid``)."""

    shown_only = ("render_azimuths", "render_heights")

    azimuths: int
    """Azimuths of the grid in training."""
    heights: int
    """Heights of the grid in training; the first is the normal and the last the horizon, and neither counts."""
    march_steps: int
    """Points a radius at which each direction is looked up."""
    render_azimuths: int
    """Azimuths of the grid of frames that are shown."""
    render_heights: int
    """Heights of the grid of frames that are shown."""

    def __post_init__(self) -> None:
        for name in ("heights", "render_heights"):
            if getattr(self, name) < 3:
                raise UsageError(
                    f"{name}: {getattr(self, name)} is less than 3",
                    "The first one is the normal and the last one the horizon; neither counts.",
                )


PRESETS = by_name(
    Budget(
        name="smoke",
        geometry=GEOMETRY_PRESETS["smoke"],
        inverse_iterations=20,
        azimuths=8,
        heights=5,
        march_steps=8,
        light_height=8,
        render_azimuths=8,
        render_heights=5,
    ),
    Budget(
        name="tiny",
        geometry=GEOMETRY_PRESETS["tiny"],
        inverse_iterations=600,
        azimuths=8,
        heights=5,
        march_steps=16,
        light_height=16,
        render_azimuths=16,
        render_heights=9,
    ),
    Budget(
        name="small",
        geometry=GEOMETRY_PRESETS["small"],
        inverse_iterations=3000,
        azimuths=16,
        heights=9,
        march_steps=16,
        light_height=32,
        render_azimuths=32,
        render_heights=17,
    ),
    Budget(
        name="paper",
        geometry=GEOMETRY_PRESETS["paper"],
        inverse_iterations=5000,
        azimuths=32,
        heights=17,
        march_steps=16,
        light_height=64,
        render_azimuths=32,
        render_heights=17,
    ),
)


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
class MaterialStart(StartValues):
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


@dataclass(frozen=True)
class Variant(SurfelVariant):
    """A variant of GI-GS; the defaults are the full method. Lengths are in the scene's extents."""

    shown_only = ("relight_indirect", "frame")

    indirect: bool = True
    """Whether training, and images under the recovered light, have the bounce that is gathered on the screen."""
    relight_indirect: bool = True
    """Whether relit images have that bounce."""
    occlusion: bool = True
    """Whether training, and images under the recovered light, have the occlusion found on the screen."""
    sum: Sum = "display"
    """Where direct and indirect light are added (see ``Sum``)."""
    frame: Frame = "oriented"
    """Frame in which a new light is looked up (see ``split_sum.Frame``)."""
    metallic: bool = False
    """Whether a share of metal is learnt for each surfel: it colours the lobe by the albedo, and metal sends no
    bounce."""
    start: int = 8
    """First step of each march, in sixteenths of the radius; nearer surfaces are not hit. From 16 on nothing is."""
    readme_bug: bool = False
    """Whether training marches from ``README_START`` on, as the published README's command says: it then finds nothing,
    but images are shown with what ``start`` finds."""
    radius: float = 0.176
    """Length of a march (the script's 0.8)."""
    bias: float = 0.0022
    """Distance behind the marched point up to which a surface counts as hit (the script's 0.01)."""
    thick: float = 0.011
    """Distance before the marched point up to which a surface counts as hit (the script's 0.05)."""
    far: float = 22.0
    """Depth over which the radius grows: it is multiplied by (1 + depth / far)^2 (the script's 100)."""
    lr_scale: float = 1.0
    """Share of the learning rates that stage 1 ends with at which geometry moves in stage 2, through the blending of
    the maps alone; at 0 it is frozen."""
    materials: MaterialLearning = field(default_factory=MaterialLearning)
    """Weights, rates and starting values of stage 2."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require("zero or above", "start", "bias", "thick", "lr_scale")
        self.require("above zero", "radius", "far")

    @property
    def training_start(self) -> int:
        """First step of each march in training."""
        return README_START if self.readme_bug else self.start
