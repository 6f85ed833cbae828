"""What an ablation of TensoIR changes."""

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from radiogs_core.errors import UsageError

from .learning import Learning

SHOWN_ONLY = ("shown", "relight_visibility")
"""Fields that training does not read."""

INVERSE_ONLY = ("indirect", "visibility", "normals", "background", *SHOWN_ONLY)
"""Fields that the stage of the radiance field does not read."""


@dataclass(frozen=True)
class Variant:
    """A variant of TensoIR; the defaults are the full method.

    indirect: whether points are lit by the radiance that rays meet in the field. visibility: whether density on the
    way hides the light in training.
    normals: those that points are shaded with: of the network, tied to the density by a loss, or of the density itself.
    linear: whether the field's radiance is linear from the second stage on, as published, or from the start.
    background: what training images are composited on: white, as published, which a white surface is not told from; or
    from the second stage on a grey that is drawn for each ray. (From the start on, that leaves the field empty.)
    shown: what images under the recovered light are: the marched radiance field, which TensoIR's are, or shaded.
    relight_visibility: whether density hides the light in relighting.
    view_share: share of the training views that both stages may see, in (0, 1].
    learning: weights, rates and schedule.
    """

    indirect: bool = True
    visibility: bool = True
    normals: Literal["predicted", "derived"] = "predicted"
    linear: Literal["later", "from-start"] = "later"
    background: Literal["random-later", "white"] = "random-later"
    shown: Literal["field", "shaded"] = "field"
    relight_visibility: bool = True
    view_share: float = 1.0
    learning: Learning = field(default_factory=Learning)

    def __post_init__(self) -> None:
        if not 0 < self.view_share <= 1:
            raise UsageError(f"view_share: {self.view_share} is not above 0 and at most 1")
        schedule = self.learning.schedule
        for name in ("finer_at", "emptied_at"):
            if any(not 0 <= share < 1 for share in getattr(schedule, name)):
                raise UsageError(f"learning.schedule.{name}: {getattr(schedule, name)} are not all in [0, 1)")

    def of_training(self) -> dict[str, Any]:
        """The fields that decide the trained model, as plain values."""
        return {name: value for name, value in asdict(self).items() if name not in SHOWN_ONLY}

    def of_field(self) -> dict[str, Any]:
        """The fields that decide the radiance field of the first stage, as plain values."""
        found = {name: value for name, value in asdict(self).items() if name not in INVERSE_ONLY}
        learning = {name: found["learning"][name] for name in ("radiance_field", "rates")}
        return found | {"learning": learning}
