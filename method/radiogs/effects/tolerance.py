"""From a tolerated loss of PSNR to an error between images, and back.

MSE_0 is the error that the method makes anyway, against the images; m is the mean squared difference that leaving an
effect out makes between its own images. The error after it is MSE_0 + m + 2 c, c the mean product of both errors.
"""

import math
from dataclasses import dataclass

TOLERANCE_DB = 0.1

LOCAL_TOLERANCE_DB = 3.0
"""Tolerated loss in one tile of an image, whatever the mean: the error there at most doubles."""


@dataclass(frozen=True)
class Tolerance:
    """A tolerated loss of PSNR, given the method's own error ``mse`` (display sRGB, over covered pixels)."""

    mse: float
    decibel: float = TOLERANCE_DB
    local_decibel: float = LOCAL_TOLERANCE_DB

    @property
    def error(self) -> float:
        """Rise of the mean squared error that costs ``decibel``."""
        return self.mse * (10 ** (self.decibel / 10) - 1)

    @property
    def local_error(self) -> float:
        """Rise of the squared error of one tile that costs ``local_decibel``."""
        return self.mse * (10 ** (self.local_decibel / 10) - 1)

    def loss(self, rise: float) -> float:
        """dB that a rise of the squared error costs: 10 log10(1 + rise / MSE_0)."""
        return decibels(1 + rise / self.mse) if self.mse > 0 else (math.inf if rise > 0 else 0.0)

    def worst_case(self, difference: float) -> float:
        """dB that a mean squared difference m costs at most, however it correlates with the method's own error.

        By the triangle inequality 20 log10(1 + sqrt(m / MSE_0)).
        """
        if self.mse <= 0:
            return math.inf if difference > 0 else 0.0
        return 2 * decibels(1 + math.sqrt(max(difference, 0.0) / self.mse))


def decibels(ratio: float) -> float:
    """10 log10 of a ratio of energies; 0 at or below one, where nothing is lost."""
    return 10 * math.log10(max(ratio, 1.0)) if math.isfinite(ratio) else math.inf
