"""The first steps of a stage, one by one: its weighted losses, and lengths of gradients and of updates.

They are read and nothing is changed, so that training gives the same bits. After so few steps rounding has not yet
grown: a lost term, another weight or another learning rate shows there before it shows in any metric.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Protocol, runtime_checkable

import torch
from torch import Tensor

from radiogs_core.contract import Stage

from ..store.schema import FirstStep

FIRST_STEPS = 8
"""How many steps of every stage are recorded."""


@runtime_checkable
class HoldsTensors(Protocol):
    """An optimiser that names what it optimises (``radiogs_core.surfels.optimiser.SurfelOptimiser`` is one)."""

    tensors: Mapping[str, Tensor]
    """The tensors that are learnt, by name."""


Lengths = tuple[dict[str, float], dict[str, float]]
"""Euclidean lengths of the gradients and of the updates of one step, by the names of the tensors."""


class FirstSteps:
    """Records the first steps of a stage; ``steps`` are plain values from which the record can be continued."""

    def __init__(self, steps: Sequence[FirstStep] = ()) -> None:
        self.steps = list(steps)

    @contextmanager
    def watching(self, stage: Stage) -> Iterator[Lengths]:
        """Fill in the lengths of the step that is taken in the block.

        They stay empty after the first steps, and for a stage whose ``optimiser`` does not name its tensors.
        """
        gradients: dict[str, float] = {}
        updates: dict[str, float] = {}
        optimiser = getattr(stage, "optimiser", None)
        if stage.iteration >= FIRST_STEPS or not isinstance(optimiser, HoldsTensors):
            yield gradients, updates
            return
        before = {name: value.detach().clone() for name, value in optimiser.tensors.items()}
        hooks = [
            value.register_post_accumulate_grad_hook(_reader(name, gradients))
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
        """Add the step that has ended with ``iteration``, if it is among the first ones."""
        if iteration <= FIRST_STEPS:
            gradients, updates = lengths
            self.steps.append(FirstStep(iteration=iteration, losses=dict(losses), gradients=gradients, updates=updates))


def _reader(name: str, into: dict[str, float]) -> Callable[[Tensor], None]:
    def read(value: Tensor) -> None:
        if value.grad is not None:
            into[name] = _length(value.grad)

    return read


def _length(value: Tensor) -> float:
    return float(torch.linalg.vector_norm(value.detach().double()))
