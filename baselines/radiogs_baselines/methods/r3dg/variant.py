"""What an ablation of R3DG changes."""

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from radiogs_core.errors import UsageError
from radiogs_core.learning.geometry import GeometryLearning

from .learning import MaterialLearning

LocalLight = Literal["free", "gated", "none"]
"""The light of a surfel's own harmonics: added as it is, multiplied by 1 - V, or zero."""

Visibility = Literal["table", "retraced"]
"""V along directions that are traced once; or, in training, traced anew along directions turned at random."""

SHOWN_ONLY = ("relight_local_light",)
"""Fields that training does not read."""


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
