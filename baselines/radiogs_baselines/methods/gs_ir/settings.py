"""Settings of GS-IR: how much work a run does, how it learns materials and light, and what an ablation changes.

Unless a field states otherwise, defaults are the published scripts' for TensoIR's scenes.
"""

from dataclasses import dataclass, field
from typing import Literal

from radiogs_core.on_surfels.settings import MaterialLearning, SurfelBudget, SurfelVariant, presets
from radiogs_core.on_surfels.split_sum_light import Frame
from radiogs_core.plain_values import NotNegative, require
from radiogs_core.transport.prefiltered_light import Masking

from .metallic import MetallicStart


@dataclass(frozen=True, kw_only=True)
class Budget(SurfelBudget):
    """Computational effort of a run. A step of stage 2 shades all pixels of one view."""

    occlusion_corners: int
    """Corners along an edge of the lattice on which occlusion is baked before stage 2."""
    occlusion_directions: int
    """Rays traced from each corner near a surface."""
    occlusion_samples: int
    """Directions over which the occlusion of a pixel is averaged."""
    irradiance_corners: int
    """Corners along an edge of the volume of indirect irradiance."""


PRESETS = presets(
    Budget,
    inverse_iterations=(20, 600, 2500, 5000),
    occlusion_corners=(8, 32, 64, 128),
    occlusion_directions=(64, 256, 1024, 4096),
    occlusion_samples=(16, 32, 128, 256),
    irradiance_corners=(6, 32, 32, 64),
    light_height=(8, 16, 32, 32),
)


@dataclass(frozen=True)
class MaterialWeights(NotNegative):
    """Weights of the losses; 0 leaves one out."""

    shaded: float = 1.0
    """Weight of L1 between the shaded image and the training image, display sRGB."""
    smoothness: float = 1.0
    """Weight of the squared differences of albedo, roughness and metalness of neighbouring pixels, down-weighted
    at image edges."""
    prior: float = 0.001
    """Weight of the mean of 1 - roughness plus the mean metalness: prefers rough, non-metallic materials."""
    light_smoothness: float = 0.01
    """Weight of the squared differences of neighbouring texels' log-radiance."""


@dataclass(frozen=True)
class MaterialRates(NotNegative):
    """Adam's learning rates; all equal the published script's rate of opacities."""

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


TexelAreas = Literal["exact", "approximate"]
"""Solid angles of texels in the diffuse pre-filter: exact, or as in GS-IR's code, where they are 8 % too large."""


@dataclass(frozen=True)
class Variant(SurfelVariant):
    """A variant of GS-IR; the defaults are the full method. Lengths are in the scene's extents."""

    shown_only = ("frame",)

    occlusion: bool = True
    """Whether the diffuse part is occluded, O L_env + (1 - O) L_ind; otherwise O = 1."""
    indirect: bool = True
    """Whether a volume of irradiance is learnt; otherwise L_ind = 0. Without occlusion L_ind is 0, too."""
    tau: float | None = 0.055
    """Distance from which on geometry does not occlude (the script's 0.25 is 0.055 of TensoIR's); None: no limit."""
    nearest: float = 0.0
    """Distance up to which geometry does not occlude; the published rasterizer skips Gaussians nearer than 0.2, which
    is 0.044 of the extent of TensoIR's scenes."""
    metallic: bool = False
    """Whether a metalness is learnt, which interpolates F0 between 0.04 and the albedo."""
    texel_areas: TexelAreas = "exact"
    """Solid angles of texels in the diffuse pre-filter (see ``TexelAreas``)."""
    masking: Masking = "height-correlated"
    """Masking in the pre-integrated BRDF (see ``prefiltered_light.Masking``)."""
    frame: Frame = "oriented"
    """Frame in which a new light is looked up (see ``split_sum.Frame``)."""
    lr_scale: float = 1.0
    """Factor on stage 1's final learning rates of geometry in stage 2; at 0 geometry is frozen."""
    materials: MaterialLearning[MaterialWeights, MaterialRates, MetallicStart] = field(
        default=MaterialLearning(
            MaterialWeights(), MaterialRates(), MetallicStart(albedo=0.731, roughness=0.742, metallic=0.731)
        )
    )
    """Weights, rates and starting values of stage 2."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self, "above zero", "tau")
        require(self, "zero or above", "nearest", "lr_scale")
