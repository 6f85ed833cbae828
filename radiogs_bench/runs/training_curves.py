"""Losses and metrics during a stage: at geometrically spaced steps (its trail), and its first steps one by one."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any

import torch
from torch import Tensor

from radiogs_core.contract import Stage

from ..store.schema import FirstStep, TrailPoint

POINTS_A_DOUBLING = 4
"""Eighteen points to 20 steps, 60 to 20,000: enough to draw a curve over the logarithm of the step."""

SCORED_AT = (1 / 8, 1 / 4, 1 / 2, 1.0)
"""Shares of a stage's steps after which its model is scored, if that is asked for."""

Sums = dict[str, tuple[float, int]]
"""For each loss: its sum over steps, and the number of steps."""


class Trail:
    """Sums the losses of every step, and closes points; it continues from ``points`` and ``since``, plain values."""

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


FIRST_STEPS = 8
"""How many steps of every stage are recorded."""

Lengths = tuple[dict[str, float], dict[str, float]]
"""Euclidean lengths of the gradients and of the updates of one step, by the names of the tensors."""


class FirstSteps:
    """Records the first steps of a stage: weighted losses, and lengths of gradients and of updates.

    ``steps`` are plain values from which the record can be continued. Recording does not change the training's bits.
    After so few steps rounding errors are still small: a lost term, another weight or another learning rate shows there
    before it shows in any metric.
    """

    def __init__(self, steps: Sequence[FirstStep] = ()) -> None:
        self.steps = list(steps)

    @contextmanager
    def watching(self, stage: Stage) -> Iterator[Lengths]:
        """Fill in the lengths of the step that is taken in the block.

        They stay empty after the first steps, and for a stage whose ``optimiser`` does not name its ``tensors``, as
        ``radiogs_core.surfels.optimiser.SurfelOptimiser`` does.
        """
        gradients: dict[str, float] = {}
        updates: dict[str, float] = {}
        optimiser: Any = getattr(stage, "optimiser", None)
        if stage.iteration >= FIRST_STEPS or not isinstance(getattr(optimiser, "tensors", None), Mapping):
            yield gradients, updates
            return
        before = {name: value.detach().clone() for name, value in optimiser.tensors.items()}

        def read(name: str, value: Tensor) -> None:
            if value.grad is not None:
                gradients[name] = _length(value.grad)

        hooks = [
            value.register_post_accumulate_grad_hook(partial(read, name))
            for name, value in optimiser.tensors.items()
            if value.requires_grad and value.is_leaf
        ]
        try:
            yield gradients, updates
        finally:
            for hook in hooks:
                hook.remove()
        for name, value in optimiser.tensors.items():
            if name in before and before[name].shape == value.shape:
                updates[name] = _length(value.detach() - before[name])

    def add(self, iteration: int, losses: Mapping[str, float], lengths: Lengths) -> None:
        """Add the step that ended with ``iteration``, if it is one of the first."""
        if iteration <= FIRST_STEPS:
            gradients, updates = lengths
            self.steps.append(FirstStep(iteration=iteration, losses=dict(losses), gradients=gradients, updates=updates))


def _length(value: Tensor) -> float:
    return float(torch.linalg.vector_norm(value.detach().double()))
