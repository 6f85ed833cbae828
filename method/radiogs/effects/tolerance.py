"""Conversion between a tolerated loss of PSNR and errors between images.

MSE_0 is the method's own error against the training images; m is the mean squared difference of the method's images
with and without an effect. The error without the effect is MSE_0 + m + 2 c, with c the mean product of both errors.
"""

import math
from dataclasses import dataclass

TOLERANCE_DB = 0.1
"""Tolerated loss, dB of PSNR."""

LOCAL_TOLERANCE_DB = 3.0
"""Tolerated loss in one tile of an image, dB: the squared error in the tile at most doubles."""


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
