"""Learning rates of a ``RadianceSolver``. A stage that only stores them does not depend on the solver and its rays."""

from dataclasses import dataclass
from typing import Literal

from ..plain_values import require


@dataclass(frozen=True)
class SolverRates:
    """Learning rates of a ``RadianceSolver``."""

    degree_0: float = 0.3
    """Rate of the harmonics of degree 0 at the start, times ``unit``."""
    unit: Literal["mean radiance", "one"] = "mean radiance"
    """Unit of the rates: the scene's mean radiance under the light, so that a rate suits every light, or one, as in
    training."""
    rest_share: float = 0.05
    """Ratio of the higher degrees' rate to degree 0's (3DGS); at 0.25 the noise of fifteen harmonics costs ``corner`` 5
    dB."""
    last_share: float = 0.02
    """Share of the rates that is left at the end of a cosine schedule; it bounds the noise that samples leave in the
    radiance. 1: constant rates."""

    def __post_init__(self) -> None:
        require(self, "zero or above", "degree_0", "rest_share")
        require(self, "between 0 and 1", "last_share")
