"""Settings of GI-GS: how much work a run does, how it learns materials and light, and what an ablation changes.

Unless a field states otherwise, defaults are the published script's, which are GS-IR's; shares of the stage are shares
of its iterations.
"""

from dataclasses import dataclass, field
from typing import Literal

from radiogs_core.errors import UsageError
from radiogs_core.on_surfels.settings import MaterialLearning, SurfelBudget, SurfelVariant, presets
from radiogs_core.on_surfels.split_sum_light import Frame
from radiogs_core.plain_values import NotNegative, require
from radiogs_core.transport.prefiltered_light import Masking

from ..gs_ir.metallic import MetallicStart


@dataclass(frozen=True, kw_only=True)
class Budget(SurfelBudget):
    """Computational effort of a run. Every frame marches from every pixel along a grid of directions (``grid``)."""

    shown_only = ("render_azimuths", "render_heights")

    azimuths: int
    """Azimuths of the grid of directions in training."""
    heights: int
    """Polar angles of the grid in training, normal and horizon included; these two have no weight."""
    march_steps: int
    """Steps of a march in one radius."""
    render_azimuths: int
    """Azimuths of the grid in rendered frames after training."""
    render_heights: int
    """Polar angles of the grid in rendered frames after training."""

    def __post_init__(self) -> None:
        for name in ("heights", "render_heights"):
            if getattr(self, name) < 3:
                raise UsageError(
                    f"{name}: {getattr(self, name)} is less than 3",
                    "The first polar angle is the normal and the last the horizon; neither has a weight.",
                )


PRESETS = presets(
    Budget,
    inverse_iterations=(20, 600, 3000, 5000),
    azimuths=(8, 8, 16, 32),
    heights=(5, 5, 9, 17),
    march_steps=(8, 16, 16, 16),
    light_height=(8, 16, 32, 64),
    render_azimuths=(8, 16, 32, 32),
    render_heights=(5, 9, 17, 17),
)


@dataclass(frozen=True)
class MaterialWeights(NotNegative):
    """Weights of the losses; 0 leaves one out."""

    shaded: float = 1.0
    """Weight of L1 between the shaded image and the training image, display sRGB."""
    variation: float = 1.0
    """Weight of the squared differences of albedo, roughness and metalness between neighbouring pixels."""
    plainness: float = 0.001
    """Weight of the distance of roughness from 1 and of metalness from 0."""
    light_smoothness: float = 0.01
    """Weight of the squared differences of neighbouring texels' log-radiance."""


@dataclass(frozen=True)
class MaterialRates(NotNegative):
    """Adam's learning rates."""

    albedo: float = 0.05
    """Rate of the albedo's logits at the start."""
    albedo_end: float = 0.05 * 10**-0.5
    """Rate of the albedo's logits at the end, with geometric decay in between: the published script decays to a tenth
    in 10,000 steps and stops after 5,000."""
    roughness: float = 0.05
    """Rate of the roughness' logits."""
    metallic: float = 0.05
    """Rate of the metalness' logits."""
    light: float = 0.05
    """Rate of the light's log-radiance."""


Sum = Literal["display", "linear"]
"""Colour space in which direct and indirect light are added: display sRGB, each encoded separately, or linear."""

WHOLE_MARCH = 16
"""Steps in a radius of the published script; ``Variant.start`` is given in these."""

README_START = 64
"""First step of the march in the training command of the published README; it lies beyond the last step."""


@dataclass(frozen=True)
class Variant(SurfelVariant):
    """A variant of GI-GS; the defaults are the full method. Lengths are in the scene's extents."""

    shown_only = ("relight_indirect", "frame")

    indirect: bool = True
    """Whether training, and images under the recovered light, include the screen-space bounce."""
    relight_indirect: bool = True
    """Whether relit images include the screen-space bounce."""
    occlusion: bool = True
    """Whether training, and images under the recovered light, include screen-space occlusion."""
    sum: Sum = "display"
    """Colour space in which direct and indirect light are added (see ``Sum``)."""
    masking: Masking = "height-correlated"
    """Masking in the pre-integrated BRDF (see ``prefiltered_light.Masking``)."""
    frame: Frame = "oriented"
    """Frame in which a new light is looked up (see ``split_sum.Frame``)."""
    metallic: bool = False
    """Whether each surfel has a learnt metalness: it tints the specular lobe by the albedo and reduces the bounce."""
    start: int = 8
    """First step of each march, in sixteenths of the radius; nearer surfaces are not hit. From 16 on, none is hit."""
    readme_bug: bool = False
    """Whether training marches start at ``README_START``, as in the published README's command: training then finds no
    occluder, while rendered images still use ``start``."""
    radius: float = 0.176
    """Length of a march (0.8 world units in the published script)."""
    bias: float = 0.0022
    """Distance behind the marched position up to which a surface counts as hit (0.01 world units in the published
    script)."""
    thick: float = 0.011
    """Distance before the marched position up to which a surface counts as hit (0.05 world units in the published
    script)."""
    far: float = 22.0
    """Depth over which the radius grows: it is multiplied by (1 + depth / far)^2 (100 world units in the published
    script)."""
    lr_scale: float = 1.0
    """Factor on stage 1's final learning rates of geometry in stage 2, whose gradient comes only from the blending of
    the maps; at 0 geometry is frozen."""
    materials: MaterialLearning[MaterialWeights, MaterialRates, MetallicStart] = field(
        default=MaterialLearning(
            MaterialWeights(), MaterialRates(), MetallicStart(albedo=0.73, roughness=0.73, metallic=0.73)
        )
    )
    """Weights, rates and starting values of stage 2."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self, "zero or above", "start", "bias", "thick", "lr_scale")
        require(self, "above zero", "radius", "far")

    @property
    def training_start(self) -> int:
        """First step of each march in training."""
        return README_START if self.readme_bug else self.start
