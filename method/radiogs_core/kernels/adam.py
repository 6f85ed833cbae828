"""K18: one Adam step of any number of tensors, each at its own learning rate, in one launch."""

from collections.abc import Mapping, Sequence
from functools import cache
from itertools import accumulate
from typing import Any

import torch
import warp as wp
from torch import Tensor

from .native_kernel import DOUBLES, INTEGERS, LONGS, native_file, native_kernel
from .runtime import NATIVE, launch_in_parallel

ADAM = native_file(__package__, "adam.inl")

BLOCK = 4096
"""Entries of an item: enough that finding its tensor costs nothing, few enough that workers share small models."""

MEAN_DECAY, SQUARE_DECAY = 0.9, 0.999
"""Adam's beta_1 and beta_2 (Kingma and Ba 2015)."""

MOMENTS = ("exp_avg", "exp_avg_sq")
"""Names of the means of gradients and of their squares."""


class Adam:
    """Adam over named tensors (Kingma and Ba 2015). A tensor's moments begin with its first gradient.

    Args:
        guard: Added to the root of the second moment: epsilon. Gradients below it hardly move a value.
    """

    def __init__(self, guard: float) -> None:
        self.guard = guard
        self.moments: dict[str, dict[str, Any]] = {}
        """By tensor: its MOMENTS, and ``step``, the number of steps that they have seen."""

    def step(self, tensors: Mapping[str, Tensor], rates: Mapping[str, float]) -> None:
        """One step of all tensors that have a gradient, in place; the gradients are cleared.

        Tensors have to be contiguous, of one scalar type and on one device.
        """
        learnt = {name: value for name, value in tensors.items() if value.grad is not None and value.numel()}
        if not learnt:
            return
        gradients = {name: value.grad.contiguous() for name, value in learnt.items() if value.grad is not None}
        table, factors = [], []
        for name, value in learnt.items():
            if name not in self.moments:
                self.moments[name] = {"step": 0, **{key: torch.zeros_like(value) for key in MOMENTS}}
            moments = self.moments[name]
            moments["step"] += 1
            places = value, gradients[name], *(moments[key] for key in MOMENTS)
            table.append([each.data_ptr() for each in places])
            corrections = 1 - MEAN_DECAY ** moments["step"], (1 - SQUARE_DECAY ** moments["step"]) ** 0.5
            factors.append([rates[name], *corrections])
        one = next(iter(learnt.values()))
        _launch(one, self.guard, [value.numel() for value in learnt.values()], table, factors)
        for value in learnt.values():
            value.grad = None

    def state(self) -> dict[str, dict[str, Any]]:
        """The moments by tensor, for ``restore``."""
        return {name: dict(moments) for name, moments in self.moments.items()}

    def restore(self, state: Mapping[str, Mapping[str, Any]]) -> None:
        """Continue from what ``state`` returned, with copies of its tensors."""
        self.moments = {
            name: {key: value.clone() if isinstance(value, Tensor) else value for key, value in moments.items()}
            for name, moments in state.items()
        }


def _launch(
    like: Tensor, guard: float, lengths: Sequence[int], table: list[list[int]], factors: list[list[float]]
) -> None:
    """Step tensors of the type and on the device of ``like``; for ``table`` and ``factors`` see ``adam.inl``."""
    ends = list(accumulate(-(-length // BLOCK) for length in lengths))
    numbers = [torch.tensor(values, device=like.device).view(-1) for values in (table, lengths)]
    limits = torch.tensor(ends, dtype=torch.int32, device=like.device)
    scales = torch.tensor(factors, dtype=torch.float64, device=like.device).view(-1)
    launch_in_parallel(step_kernel(like.dtype, guard), ends[-1], like.device, [*numbers, limits, scales])


@cache
def step_kernel(dtype: torch.dtype, guard: float) -> wp.Kernel:
    """The kernel for a scalar type and an epsilon; an item is a block of entries of one of the tensors."""
    words = {"BLOCK_ENTRIES": BLOCK, "MEAN_DECAY": MEAN_DECAY, "SQUARE_DECAY": SQUARE_DECAY, "GUARD": guard}
    parameters = (LONGS, "memory lengths"), (INTEGERS, "ends"), (DOUBLES, "factors")
    return native_kernel(ADAM, dtype, NATIVE, "step", "block", *parameters, words=words)
