"""What one probe has measured of one effect, and what was decided."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

Verdict = Literal["on", "local", "off"]


@dataclass(frozen=True)
class Measured:
    """What leaving one effect out does, before anything is decided.

    contribution: estimate of the loss, dB of PSNR; bound: the same, one-sided; lowest: one-sided from below.
    worst: bound for the worst correlation of errors, dB. tail: largest share of the local tolerance that a tile of an
    image takes. unseen: upper bound on the share of tiles that take more than was seen, if none was over it.
    gradient: largest relative change of the gradient of anything that is learnt; 0 where it was not asked for, because
    the images alone refuse the plan, or do not change.
    share: of a step's work that the effect takes. rays, seconds: of a step; seconds are for the reader alone.
    """

    contribution: float
    lowest: float
    bound: float
    worst: float
    tail: float
    unseen: float
    gradient: float
    share: float
    rays: int
    seconds: float

    @property
    def finite(self) -> bool:
        """Whether every figure that is decided by is a number."""
        figures = (self.contribution, self.bound, self.tail, self.gradient, self.share)
        return all(math.isfinite(value) for value in figures)


@dataclass(frozen=True)
class Evidence:
    """The record of one decision."""

    effect: str
    verdict: Verdict
    why: str
    iteration: int
    seed: int
    tolerance: float
    measured: Measured | None

    def plain(self) -> dict[str, Any]:
        """Plain values; a figure that is not finite is None."""
        values = asdict(self)
        if self.measured is not None:
            values["measured"] = {
                name: value if math.isfinite(value) else None for name, value in asdict(self.measured).items()
            }
        return values

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "Evidence":
        """The inverse of ``plain``; what was not finite comes back as infinity."""
        measured = None
        if values["measured"] is not None:
            figures: dict[str, Any] = {
                name: math.inf if value is None else value for name, value in values["measured"].items()
            }
            measured = Measured(**figures)
        return cls(**{**values, "measured": measured})
