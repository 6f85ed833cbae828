"""Evidence of a probe: measurements for one effect, and the decision."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

Verdict = Literal["on", "local", "off"]
"""Whether an effect is simulated; "local": only where it matters."""


@dataclass(frozen=True, kw_only=True)
class Measured:
    """Measurements of the loss and of the saved work without one effect."""

    contribution: float
    """Estimated loss, dB of PSNR."""
    lowest: float
    """One-sided lower bound of the loss, dB."""
    bound: float
    """One-sided upper bound of the loss, dB."""
    worst: float
    """Loss under the worst correlation of errors, dB."""
    tail: float = 0.0
    """Largest rise of the squared error in one tile, divided by the tolerated rise in one tile."""
    unseen: float = 1.0
    """Upper bound on the share of tiles above that tolerance, if no measured tile was; 1 otherwise."""
    gradient: float = 0.0
    """Largest relative change of a gradient of the learnt quantities; 0 if it was not computed.

    It is computed only if the images change and accept the plan.
    """
    share: float
    """Share of a step's work that is saved."""
    rays: int
    """Number of rays that a step saves."""
    seconds: float = 0.0
    """Seconds that a step saves, by an estimate; no decision depends on it."""

    @property
    def finite(self) -> bool:
        """Whether all values that the decision depends on are finite."""
        values = (self.contribution, self.bound, self.tail, self.gradient, self.share)
        return all(math.isfinite(value) for value in values)


@dataclass(frozen=True)
class Evidence:
    """The record of one decision; see ``radiogs_core.capabilities.EffectRecord``."""

    effect: str
    """Name of the effect; ``plan`` for the plan as a whole."""
    verdict: Verdict
    """The decision."""
    why: str
    """The reason, in words."""
    iteration: int
    """Iteration of training."""
    seed: int
    """Seed of the probe."""
    tolerance: float
    """Tolerated loss, dB of PSNR."""
    measured: Measured | None
    """Measurements; None if the probe failed or nothing was measured."""

    def plain(self) -> dict[str, Any]:
        """Plain values; a measurement that is not finite becomes None."""
        values = asdict(self)
        if self.measured is not None:
            values["measured"] = {
                name: value if math.isfinite(value) else None for name, value in asdict(self.measured).items()
            }
        return values

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "Evidence":
        """The inverse of ``plain``; a measurement of None becomes infinity."""
        measured = None
        if values["measured"] is not None:
            numbers: dict[str, Any] = {
                name: math.inf if value is None else value for name, value in values["measured"].items()
            }
            measured = Measured(**numbers)
        return cls(**{**values, "measured": measured})
