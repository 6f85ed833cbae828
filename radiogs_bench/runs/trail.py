"""Losses and metrics during a stage, at geometrically spaced steps."""

from collections.abc import Mapping, Sequence

from ..store.schema import TrailPoint

POINTS_A_DOUBLING = 4
"""Eighteen points to 20 steps, 60 to 20,000: enough to draw a curve over the logarithm of the step."""

SCORED_AT = (1 / 8, 1 / 4, 1 / 2, 1.0)
"""Shares of a stage's steps after which its model is scored, if that is asked for."""

Sums = dict[str, tuple[float, int]]
"""For each loss: its sum over steps, and the number of steps."""


class Trail:
    """Sums the losses of every step, and closes a point at some steps.

    ``points`` and ``since`` (sums after the last point) are plain values from which a trail can be continued.
    """

    def __init__(self, iterations: int, points: Sequence[TrailPoint], since: Mapping[str, tuple[float, int]],
                 scored: bool) -> None:  # fmt: skip
        self.points, self.since = list(points), dict(since)
        self._scored = {max(1, round(share * iterations)) for share in SCORED_AT} if scored else set()
        self._due = milestones(iterations) | self._scored

    def add(self, losses: Mapping[str, float]) -> None:
        """Add one step's losses; a loss may appear later than others."""
        for name, value in losses.items():
            total, count = self.since.get(name, (0.0, 0))
            self.since[name] = (total + value, count + 1)

    def due(self, iteration: int) -> bool:
        """Whether a point is closed after this many steps."""
        return iteration in self._due

    def to_be_scored(self, iteration: int) -> bool:
        """Whether the model is scored after this many steps."""
        return iteration in self._scored

    def close(self, iteration: int, seconds: float, metrics: Mapping[str, float]) -> None:
        """Add a point with the mean losses since the previous one, and start new sums."""
        losses = {name: total / count for name, (total, count) in self.since.items()}
        self.points.append(TrailPoint(iteration=iteration, seconds=seconds, losses=losses, metrics=dict(metrics)))
        self.since = {}


def milestones(iterations: int) -> set[int]:
    """Steps from the first to the last, each about 1.2 times the previous one."""
    found, index = {iterations}, 0
    while (step := round(2 ** (index / POINTS_A_DOUBLING))) < iterations:
        found.add(step)
        index += 1
    return found
