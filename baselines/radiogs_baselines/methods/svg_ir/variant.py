"""What an ablation of SVG-IR changes."""

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from radiogs_core.errors import UsageError
from radiogs_core.learning.geometry import GeometryLearning

from .learning import MaterialLearning

Attributes = Literal["bilinear", "constant"]
"""Materials and normals of a surfel: bilinear between four vertices, or one for the whole surfel."""

SHOWN_ONLY = ("relight_indirect", "relight_rows")
"""Fields that training does not read."""


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
