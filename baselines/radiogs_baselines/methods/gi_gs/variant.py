"""What an ablation of GI-GS changes."""

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from radiogs_core.errors import UsageError
from radiogs_core.learning.geometry import GeometryLearning

from ..split_sum import Frame
from .learning import MaterialLearning

Sum = Literal["display", "linear"]
"""Where direct and indirect light are added up: as display sRGB, each encoded by itself, or as linear radiance."""

WHOLE_MARCH = 16
"""Steps in a radius that ``Variant.start`` counts in: those of the published script."""

README_START = 64
"""First step of the march in the published README's command for training; beyond the last one."""

SHOWN_ONLY = ("relight_indirect", "frame")
"""Fields that training does not read."""


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
