"""The rule: an effect is left out only if evidence shows that it matters little, and if that saves work.

MSE_0 is the method's own error against the training images; m is the mean squared difference of the method's images
with and without an effect. The error without the effect is MSE_0 + m + 2 c, with c the mean product of both errors.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

TOLERANCE_DB = 0.1
"""Tolerated loss, dB of PSNR."""

LOCAL_TOLERANCE_DB = 3.0
"""Tolerated loss in one tile of an image, dB: the squared error in the tile at most doubles."""

LEAST_SHARE = 0.001
"""Least share of a step's work that an effect must take to be left out. Specular lobes, the cheapest, take 0.5 %."""

OFF_BELOW = 0.5
"""Hysteresis: an effect is switched off if its bound is below this share of the tolerance, and on again above the whole
tolerance; between the two its state does not change."""

GRADIENT_TOLERANCE = 0.5
"""Largest tolerated relative change of the gradient of anything that is learnt."""

Verdict = Literal["on", "off"]
"""Whether an effect is simulated."""


@dataclass(frozen=True)
class Tolerance:
    """A tolerated loss of PSNR, relative to the method's own error."""

    mse: float
    """Mean squared error MSE_0 of the method's own images, display sRGB, over covered pixels."""
    decibel: float = TOLERANCE_DB
    """Tolerated loss of the mean, dB."""

    @property
    def error(self) -> float:
        """Rise of the mean squared error that corresponds to a loss of ``decibel``."""
        return self.mse * (10 ** (self.decibel / 10) - 1)

    @property
    def local_error(self) -> float:
        """Rise of the squared error of one tile that corresponds to a loss of ``LOCAL_TOLERANCE_DB``."""
        return self.mse * (10 ** (LOCAL_TOLERANCE_DB / 10) - 1)

    def loss(self, rise: float) -> float:
        """Loss, dB, by a rise of the squared error: 10 log10(1 + rise / MSE_0)."""
        return decibels(1 + rise / self.mse) if self.mse > 0 else (math.inf if rise > 0 else 0.0)

    def worst_case(self, difference: float) -> float:
        """Largest loss, dB, by a mean squared difference m, for any correlation with the method's own error.

        By the triangle inequality it is 20 log10(1 + sqrt(m / MSE_0)).
        """
        if self.mse <= 0:
            return math.inf if difference > 0 else 0.0
        return 2 * decibels(1 + math.sqrt(max(difference, 0.0) / self.mse))


def decibels(ratio: float) -> float:
    """10 log10 of a ratio of energies; 0 for a ratio of one or less, which is no loss."""
    return 10 * math.log10(max(ratio, 1.0)) if math.isfinite(ratio) else math.inf


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
    gradient: float = 0.0
    """Largest relative change of a gradient of the learnt quantities; 0 if it was not computed.

    It is computed only if the images change and accept the plan.
    """
    share: float
    """Share of a step's work that is saved."""
    rays: int
    """Number of rays that a step saves."""

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


def decide(measured: Measured | None, was_off: bool, tolerance: float = TOLERANCE_DB) -> tuple[Verdict, str]:
    """Verdict ("on" or "off") about one effect, with the reason in words. ``tolerance``: dB of PSNR.

    The effect stays on if the probe failed (``measured`` is None) or a measured value is not finite.
    """
    if measured is None:
        return "on", "not probed, or the probe failed"
    if not measured.finite:
        return "on", "the probe measured a value that is not finite"
    if measured.share < LEAST_SHARE:
        return "on", f"takes {100 * measured.share:.1f} % of a step: nothing to gain"
    factor = 1.0 if was_off else OFF_BELOW
    if measured.bound >= factor * tolerance:
        return "on", f"may cost {measured.bound:.3f} dB, {factor * tolerance:.3f} are tolerated"
    if measured.tail >= factor:
        return "on", f"one tile loses {measured.tail:.2f} of what is tolerated locally"
    if measured.gradient >= factor * GRADIENT_TOLERANCE:
        return "on", f"gradients change by {100 * measured.gradient:.0f} %"
    return "off", f"costs at most {measured.bound:.3f} dB, saves {100 * measured.share:.0f} % of a step"
