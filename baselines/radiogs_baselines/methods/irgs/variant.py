"""What an ablation of IRGS changes."""

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from radiogs_core.errors import UsageError
from radiogs_core.learning.geometry import GeometryLearning

from .learning import MaterialLearning

Indirect = Literal["traced", "detached", "none"]
"""L_ind in training: traced with gradient to the harmonics of the surfels that rays meet, without, or zero."""

SHOWN_ONLY = ("relight_indirect", "secondary_albedo")
"""Fields that training does not read."""


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
