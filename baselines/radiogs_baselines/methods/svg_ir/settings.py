"""Settings of SVG-IR: how much work a run does, how it learns materials and light, and what an ablation changes.

Unless a field states otherwise, defaults are the published script's for TensoIR's scenes; shares of the stage are
shares of its iterations.
"""

from dataclasses import dataclass
from typing import Literal

from radiogs_core.errors import UsageError
from radiogs_core.on_surfels.settings import MaterialLearning, SurfelBudget, SurfelVariant, presets
from radiogs_core.on_surfels.start_values import StartValues
from radiogs_core.plain_values import NotNegative, require


@dataclass(frozen=True, kw_only=True)
class Budget(SurfelBudget):
    """Computational effort of a run."""

    shown_only = ("relight_samples",)

    incident_samples: int
    """Rays of each surfel in stage 2's table of incident light (S)."""
    consistency_surfels: int
    """Random surfels in each step's consistency loss; all surfels if there are fewer."""
    relight_samples: int
    """Rays of each surfel in the table of a relit model."""


PRESETS = presets(
    Budget,
    inverse_iterations=(20, 600, 3000, 20_000),
    incident_samples=(8, 16, 32, 64),
    consistency_surfels=(64, 1024, 8192, 2_000_000),
    light_height=(8, 16, 32, 64),
    relight_samples=(8, 64, 128, 384),
)


@dataclass(frozen=True)
class MaterialWeights(NotNegative):
    """Weights of the losses; 0 leaves one out."""

    shaded: float = 1.0
    """Weight of the loss between the shaded image and the training image, display sRGB: ``absolute`` L1 +
    ``similarity`` (1 - SSIM)."""
    radiance: float = 1.0
    """Weight of the loss between the image of the surfels' own radiance and the training image, with the same terms."""
    absolute: float = 0.9
    """Weight of L1 within the losses ``shaded`` and ``radiance``."""
    similarity: float = 0.1
    """Weight of 1 - SSIM within the losses ``shaded`` and ``radiance``."""
    consistency: float = 0.05
    """Weight of L1 between one-bounce radiance of the materials and the table's radiance times the ratio."""
    normal: float = 0.02
    """Weight of the distance between the blended vertex normals and the normals of the depth map."""
    offset: float = 0.1
    """Weight of the mean square of the vertices' normal offsets."""
    albedo_smoothness: float = 0.1
    """Weight of the gradients of the albedo map, down-weighted at image edges."""
    roughness_smoothness: float = 0.05
    """Weight of the gradients of the roughness map, down-weighted at image edges."""
    light_smoothness: float = 0.02
    """Weight of the squared differences of log-radiance between neighbouring texels."""


@dataclass(frozen=True)
class MaterialRates(NotNegative):
    """Adam's learning rates."""

    albedo: float = 0.01
    """Rate of the vertices' albedo logits."""
    roughness: float = 0.01
    """Rate of the vertices' roughness logits."""
    offset: float = 0.001
    """Rate of the vertices' normal offsets."""
    light: float = 0.025
    """Rate of the light's log-radiance."""
    ratio: float = 0.01
    """Rate of the ratio, the factor on the table's radiance."""
    opacity: float = 0.005
    """Rate of the surfels' opacity logits."""
    radiance: float = 0.00025
    """Rate of the surfels' harmonics of degree 0."""
    radiance_rest: float = 0.00025 / 20
    """Rate of the harmonics of higher degrees."""


@dataclass(frozen=True)
class Learning(MaterialLearning[MaterialWeights, MaterialRates, StartValues]):
    """How stage 2 learns materials and light."""

    ratio_until: float = 1_000 / 20_000
    """Share of the stage after which the ratio is frozen."""

    def __post_init__(self) -> None:
        require(self, "between 0 and 1", "ratio_until")


Attributes = Literal["bilinear", "constant"]
"""How materials and normals vary over a surfel: bilinearly between four vertices, or not at all."""


@dataclass(frozen=True)
class Variant(SurfelVariant):
    """A variant of SVG-IR; the defaults are the full method. Lengths are in the scene's extents."""

    shown_only = ("relight_indirect", "relight_rows")

    attributes: Attributes = "bilinear"
    """How materials and normals vary over a surfel (see ``Attributes``)."""
    vertex_distance: float = 1.5
    """Distance of the vertices from the surfel's axes, in its standard deviations."""
    indirect: bool = True
    """Whether the table's radiance is used as indirect light in training and under the recovered light."""
    hop: float | None = 0.044
    """Longest distance from a ray's origin to its first hit, or between consecutive hits; None: unlimited. The
    published script has 0.2 world units, 0.044 extents of TensoIR's scenes."""
    gap: float = 0.0022
    """Shortest distance between consecutive hits that count (0.01 world units in the published script)."""
    ray_start: float | None = None
    """Shortest distance to the first hit; None: one standard deviation of the surfel at the ray's origin. The published
    script has 0.042 world units, 0.0093 extents of TensoIR's scenes."""
    opaque: float = 0.2
    """Transmittance below which V is set to 0, in [0, 1)."""
    radiance_limit: float = 10.0
    """Upper limit of the table's radiance, linear."""
    light_limit: float = 64.0
    """Upper limit of the environment's radiance, linear."""
    relight_indirect: bool = True
    """Whether relit images have indirect light."""
    relight_rows: int | None = 32
    """Rows that a new light is downsampled to; None: full resolution."""
    materials: Learning = Learning(MaterialWeights(), MaterialRates(), StartValues(albedo=0.5, roughness=0.5))
    """Weights, rates and starting values of stage 2."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self, "above zero", "vertex_distance", "hop", "radiance_limit", "light_limit", "relight_rows")
        require(self, "zero or above", "gap", "ray_start")
        if not 0 <= self.opaque < 1:
            raise UsageError(f"opaque: {self.opaque} is not zero or above and below 1")

    @property
    def vertices(self) -> int:
        """Number of vertices of each surfel."""
        return 4 if self.attributes == "bilinear" else 1
