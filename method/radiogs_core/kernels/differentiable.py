"""Differentiable operations by a forward and a backward kernel, both of which read the given tensors."""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from .native_kernel import Pair
from .runtime import launch_in_parallel


def differentiable(
    kernels: Pair, count: int, constants: Sequence[Any], shapes: Sequence[Sequence[int]], *given: Tensor
) -> tuple[Tensor, ...]:
    """The outputs of a kernel, with gradient to all ``given`` tensors.

    Args:
        kernels: The forward kernel takes ``constants``, ``given`` and the outputs; the backward kernel ``constants``,
            ``given``, the gradients to the outputs, and the gradients to ``given``, of which it writes every entry.
        count: Number of items of both.
        constants: Numbers, and contiguous tensors without gradient.
        shapes: Shapes of the outputs.
        given: Tensors of one scalar type on one device.
    """
    return _Differentiable.apply(kernels, count, constants, shapes, *given)


class _Differentiable(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, kernels: Pair, count: int, constants: Sequence[Any], shapes: Sequence[Sequence[int]], *given: Tensor
    ) -> tuple[Tensor, ...]:
        given = tuple(value.contiguous() for value in given)
        out = tuple(given[0].new_empty(shape) for shape in shapes)
        launch_in_parallel(kernels.forward, count, given[0].device, [*constants, *given, *out])
        ctx.kernels, ctx.count, ctx.constants = kernels, count, constants
        ctx.save_for_backward(*given)
        return out

    @staticmethod
    def backward(ctx: Any, *pulls: Tensor) -> tuple[Tensor | None, ...]:
        given = ctx.saved_tensors
        gradients = tuple(map(torch.empty_like, given))
        arguments = [*ctx.constants, *given, *(pull.contiguous() for pull in pulls), *gradients]
        launch_in_parallel(ctx.kernels.backward, ctx.count, given[0].device, arguments)
        return None, None, None, None, *gradients
