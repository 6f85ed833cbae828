"""What an ablation of GS-IR changes."""

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from radiogs_core.errors import UsageError
from radiogs_core.learning.geometry import GeometryLearning

from ..split_sum import Frame
from .learning import MaterialLearning

TexelAreas = Literal["exact", "approximate"]
"""Solid angles of texels in the diffuse pre-filter: as they are, or those of GS-IR's code, 8 % too large."""

SHOWN_ONLY = ("frame",)
"""Fields that training does not read."""


@dataclass(frozen=True)
class Variant:
    """A variant of GS-IR; the defaults are the full method. Lengths are in the scene's extents.

    occlusion: whether the diffuse part is occluded, O L_env + (1 - O) L_ind; otherwise O = 1.
    indirect: whether a volume of irradiance is learnt; otherwise L_ind = 0. Without occlusion there is none, either.
    tau: distance from which on geometry does not occlude (the script's 0.25 is 0.055 of TensoIR's); None: no end.
    nearest: distance up to which geometry does not occlude; the published rasterizer leaves out what is nearer than
    0.2, which is 0.044 of TensoIR's.
    metallic: whether a metalness is learnt that mixes F0 from 0.04 and the albedo.
    texel_areas: see ``TexelAreas``. frame: see ``Frame``.
    lr_scale: share of the rates that stage 1 ends with at which geometry moves in stage 2; at 0 it is frozen.
    view_share: share of the training views that both stages may see, in (0, 1].
    geometry: weights, rates and schedule of stage 1. materials: those of stage 2.
    """

    occlusion: bool = True
    indirect: bool = True
    tau: float | None = 0.055
    nearest: float = 0.0
    metallic: bool = False
    texel_areas: TexelAreas = "exact"
    frame: Frame = "oriented"
    lr_scale: float = 1.0
    view_share: float = 1.0
    geometry: GeometryLearning = field(default_factory=GeometryLearning)
    materials: MaterialLearning = field(default_factory=MaterialLearning)

    def __post_init__(self) -> None:
        if self.tau is not None and self.tau <= 0:
            raise UsageError(f"tau: {self.tau} is not above zero")
        for name in ("nearest", "lr_scale"):
            if getattr(self, name) < 0:
                raise UsageError(f"{name}: {getattr(self, name)} is not zero or above")
        if not 0 < self.view_share <= 1:
            raise UsageError(f"view_share: {self.view_share} is not above 0 and at most 1")

    @property
    def straight(self) -> bool:
        """Whether images are encoded for display by straight radiance (see ``splatting.displayed``)."""
        return self.geometry.encoding == "straight"

    def of_training(self) -> dict[str, Any]:
        """The fields that decide the trained model, as plain values."""
        return {name: value for name, value in asdict(self).items() if name not in SHOWN_ONLY}
