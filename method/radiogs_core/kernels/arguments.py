"""Arguments of kernels: passes tensors as the arrays that a kernel declares, without a Warp array for each."""

import inspect
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import torch
import warp as wp

from ..errors import UsageError
from ..instruments import fire

MOST_ENTRIES = 2**31 - 1
"""Largest number of entries of a list, because kernels count entries in 32 bits."""


def require_countable(entries: int, what: str, remedy: str) -> None:
    """Raise UsageError if a list would have more entries than its kernels can count."""
    if entries > MOST_ENTRIES:
        fire(uncountable_lists=1)
        raise UsageError(f"there are {entries} {what}", f"A list holds at most {MOST_ENTRIES} entries.", remedy)


class _Array(NamedTuple):
    """An array of one axis, as a kernel declares it."""

    dtype: torch.dtype
    """Type of the scalars."""
    width: int
    """Scalars of an item: 3 for an array of vectors of three."""


def packed(kernel: wp.Kernel, arguments: Sequence[Any]) -> list[Any]:
    """The last arguments of a kernel, with contiguous tensors replaced by descriptors of their memory.

    A kernel's array of vectors takes a tensor of scalars. The tensors have to live until the kernel has finished.
    Raises UsageError for a tensor with more entries than a kernel can count, and TypeError for a tensor that is not
    contiguous or not of the declared type.
    """
    declared = _declared(kernel)
    names = declared[len(declared) - len(arguments) :]
    return [
        described(argument, kernel, *wanted) if isinstance(argument, torch.Tensor) else argument
        for argument, wanted in zip(arguments, names, strict=True)
    ]


def described(tensor: torch.Tensor, kernel: wp.Kernel, name: str, array: _Array | None) -> Any:
    """Warp's descriptor of a tensor's memory, as the array that a kernel declares. Raises as ``packed`` does."""
    if array is None or tensor.dtype != array.dtype or not tensor.is_contiguous():
        gaps = "" if tensor.is_contiguous() else " with gaps"
        raise TypeError(f"'{name}' of {kernel.key} takes {array or 'no tensor'}, not {tensor.dtype}{gaps}")
    entries = tensor.numel()
    require_countable(entries, "entries of an array", "Use fewer surfels, samples or pixels.")
    descriptor = _descriptor(array.width * tensor.element_size())
    descriptor.data = tensor.data_ptr()
    descriptor.shape[0] = entries // array.width
    return descriptor


@cache
def _declared(kernel: wp.Kernel) -> tuple[tuple[str, _Array | None], ...]:
    """Names of a kernel's parameters, and for each array of one axis its type; None for other parameters."""
    parameters = inspect.signature(kernel.func).parameters.values()
    return tuple((parameter.name, _array(parameter.annotation)) for parameter in parameters)


def _array(declared: Any) -> _Array | None:
    if not isinstance(declared, wp.array) or declared.ndim != 1:
        return None
    scalar = getattr(declared.dtype, "_wp_scalar_type_", declared.dtype)
    return _Array(wp.dtype_to_torch(scalar), wp.types.type_size(declared.dtype))


def _descriptor(stride: int) -> Any:
    """A new Warp descriptor of an array of one axis; ``stride``: bytes from item to item."""
    kind, content = _empty(stride)
    return kind.from_buffer_copy(content)


@cache
def _empty(stride: int) -> tuple[Any, bytes]:
    """The type of Warp's array descriptors, and the bytes of one without memory."""
    descriptor = wp.array(shape=(0,), strides=(stride,), dtype=wp.uint8, device="cpu").__ctype__()
    return type(descriptor), bytes(descriptor)
