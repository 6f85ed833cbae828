"""The length rule: the factor by which learning rates grow in a stage that is shorter than the paper's.

Schedules are shares of a stage (``GeometrySchedule``), so they follow its length by themselves. Rates do not: in fewer
steps of the same size a parameter does not arrive. At the paper's length the factor is 1.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class LengthRule:
    """A factor for learning rates: (``whole`` / steps) to the power ``power``, at most ``most`` and at least 1."""

    whole: int
    """Steps of the stage in the paper."""
    power: float
    """0: rates do not depend on the length. 1: their sum over the stage does not."""
    most: float = 12.0
    """Largest factor: longer steps than that spoil what they change."""

    def factor(self, steps: int) -> float:
        """The factor for a stage of so many steps.

        >>> [LengthRule(40_000, 0.83).factor(steps) for steps in (2_000, 40_000, 80_000)]
        [12.0, 1.0, 1.0]
        """
        return min(self.most, max(1.0, self.whole / steps) ** self.power)


POSITIONS = LengthRule(whole=40_000, power=0.83)
"""Positions in stage 1; rotations grow by the root of the factor (``learning.geometry.turning``). Chosen on ``corner``,
``red_white`` and ``bowl`` at 2,000 steps."""
