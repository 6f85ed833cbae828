"""What a probe has measured for one effect, and what was decided."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

Verdict = Literal["on", "local", "off"]


@dataclass(frozen=True)
class Measured:
    """What leaving one effect out does, before anything is decided.

    contribution: estimate of the loss, dB of PSNR; bound and lowest: its one-sided upper and lower bounds. worst: loss
    under the worst correlation of errors, dB. tail: largest loss of a tile of an image, over what is tolerated locally.
    unseen: upper bound on the share of tiles over that tolerance, given that none of those seen was. gradient: largest
    relative change of the gradient of anything that is learnt; 0 where it was not computed, because images alone refuse
    the plan, or do not change. share: of a step's work that leaving the effect out saves. rays, seconds: saved in a
    step; nothing is decided by seconds.
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
        """Whether every value that decisions depend on is finite."""
        values = (self.contribution, self.bound, self.tail, self.gradient, self.share)
        return all(math.isfinite(value) for value in values)


@dataclass(frozen=True)
class Evidence:
    """The record of one decision: at which iteration, with which seed of the probe and tolerance (dB), and why."""

    effect: str
    verdict: Verdict
    why: str
    iteration: int
    seed: int
    tolerance: float
    measured: Measured | None

    def plain(self) -> dict[str, Any]:
        """Plain values; a measurement that is not finite is None."""
        values = asdict(self)
        if self.measured is not None:
            values["measured"] = {
                name: value if math.isfinite(value) else None for name, value in asdict(self.measured).items()
            }
        return values

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "Evidence":
        """The inverse of ``plain``; measurements that were not finite come back as infinity."""
        measured = None
        if values["measured"] is not None:
            numbers: dict[str, Any] = {
                name: math.inf if value is None else value for name, value in values["measured"].items()
            }
            measured = Measured(**numbers)
        return cls(**{**values, "measured": measured})
