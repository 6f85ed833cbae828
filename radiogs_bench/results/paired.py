"""Paired differences of a run from its baseline, judged against the noise of a rerun.

A rerun is the baseline's run again with another number of threads: the same sources, other rounding. Its differences
from the baseline are noise alone. The judged run's differences are tested against zero with the pooled variance of
both: the judged differences vary about their mean, the rerun's about zero.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from scipy.optimize import brentq
from scipy.stats import nct, norm, t

ERROR_RATE = 0.01
"""Familywise error rate of a gate on an unchanged tree for each family (metrics, training, work), by Holm's
correction."""

BAND = 4.0
"""Tolerance of a single value that cannot be tested, in standard deviations: over the baseline's seeds if the rerun
noise is unknown; of a rerun if there is a single seed."""

POWER, SIMULATED_POWER = 0.8, 0.75
"""Power of the stated losses: with a known spread of reruns, and with the spread estimated from them."""


@dataclass(frozen=True)
class Paired:
    """Differences of one quantity over the seeds of a row on a scene, and the same differences of reruns."""

    differences: Sequence[float]
    """Current value - baseline by seed; positive is better if the quantity has a better direction."""
    noise: Sequence[float]
    """Rerun - baseline by seed and rerun; never empty."""

    @property
    def mean(self) -> float:
        """Mean difference."""
        return math.fsum(self.differences) / len(self.differences)

    @property
    def rerun(self) -> float:
        """Root mean square of the rerun's differences."""
        return root_mean_square(self.noise)

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the pooled variance."""
        return len(self.differences) - 1 + len(self.noise)

    @property
    def p_value(self) -> float:
        """One-sided p value of a mean that is not in the direction of ``mean``.

        With a single seed, whose spread is unknown, it is 0 beyond BAND times ``rerun``, else 1.
        """
        mean = self.mean
        if len(self.differences) == 1:
            return float(abs(mean) <= BAND * self.rerun)
        about_mean = math.fsum((each - mean) ** 2 for each in self.differences)
        variance = (about_mean + math.fsum(each**2 for each in self.noise)) / self.freedom
        if variance == 0:
            return float(mean == 0)
        return float(t.sf(abs(mean) / math.sqrt(variance / len(self.differences)), self.freedom))

    def beyond(self, adjusted: float, floor: float) -> bool:
        """Whether the mean exceeds noise: by its adjusted p value, and by its size beside ``rerun`` and ``floor``."""
        return adjusted < ERROR_RATE and abs(self.mean) > max(self.rerun, floor)


def root_mean_square(values: Sequence[float]) -> float:
    """Root of the mean square."""
    return math.sqrt(math.fsum(each**2 for each in values) / len(values))


def detectable(noise: Sequence[float], seeds: int, tests: int, floor: float) -> float:
    """The smallest mean loss that ``Paired.beyond`` finds with power POWER, in a family of so many ``tests``."""
    deviation = root_mean_square(noise)
    if deviation == 0:
        return floor
    error = deviation / math.sqrt(seeds)
    margin = float(norm.ppf(POWER)) * error
    if seeds == 1:
        return max(BAND * deviation, floor) + margin
    freedom = seeds - 1 + len(noise)
    critical = float(t.isf(ERROR_RATE / tests, freedom))
    largest = 10 * (critical + 10)
    shift = brentq(lambda centre: float(nct.sf(critical, freedom, centre)) - POWER, 0.0, largest)
    return max(float(shift) * error, max(deviation, floor) + margin)
