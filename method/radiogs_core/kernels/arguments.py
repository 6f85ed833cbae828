"""Arguments of kernels: writes tensors into memory as the arrays that a kernel declares.

Types, strides and numbers of axes of the arrays are written once for a kernel, and then only addresses and lengths: a
Warp array for each tensor, or ``wp.launch``, describes and checks all of them for every launch.
"""

import ctypes
from collections.abc import Sequence
from typing import Any

import torch
import warp as wp

from ..errors import UsageError
from ..instruments import fire
from ..scene.camera import Camera

MOST_ENTRIES = 2**31 - 1
"""Largest number of entries of a list, because kernels count entries in 32 bits."""

ADDRESS, LENGTH = 8, 4
"""Bytes of an array's address, and of the length of its axis."""


def require_countable(entries: int, what: str, remedy: str) -> None:
    """Raise UsageError if a list would have more entries than its kernels can count."""
    if entries > MOST_ENTRIES:
        fire(uncountable_lists=1)
        raise UsageError(f"there are {entries} {what}", f"A list holds at most {MOST_ENTRIES} entries.", remedy)


def lens_of(camera: Camera) -> wp.vec4d:
    """The camera's fx, fy, cx and cy, pixels, as kernels take them."""
    return wp.vec4d(camera.fx, camera.fy, camera.cx, camera.cy)


class Arguments:
    """Values of a kernel's parameters after the first in memory, as native code reads them.

    Args:
        kernel: The kernel.
        kind: Type of the ctypes structure that holds all parameters by their names.
    """

    def __init__(self, kernel: wp.Kernel, kind: Any) -> None:
        memory = bytearray(-(-ctypes.sizeof(kind) // ADDRESS) * ADDRESS)
        self.kernel, self.structure = kernel.key, kind.from_buffer(memory)
        self._addresses, self._lengths = memoryview(memory).cast("Q"), memoryview(memory).cast("i")
        self._places = [_place(self.structure, each.label, each.type) for each in kernel.adj.args[1:]]

    def write(self, values: Sequence[Any]) -> None:
        """Write a value for each parameter: contiguous tensors as arrays, other values as they are.

        An array of vectors takes a tensor of scalars; None is an array without memory. Tensors are not kept alive.
        Raises UsageError for a tensor with more entries than a kernel can count, and TypeError for a tensor that is not
        contiguous or not of the declared type.
        """
        addresses, lengths = self._addresses, self._lengths
        for value, (name, dtype, width, address, length) in zip(values, self._places, strict=True):
            if isinstance(value, torch.Tensor):
                if value.dtype is not dtype or not value.is_contiguous():
                    gaps = "" if value.is_contiguous() else " with gaps"
                    takes = f"an array of {dtype}" if dtype else "no tensor"
                    raise TypeError(f"'{name}' of {self.kernel} takes {takes}, not {value.dtype}{gaps}")
                entries = value.numel()
                if entries > MOST_ENTRIES:
                    require_countable(entries, "entries of an array", "Use fewer surfels, samples or pixels.")
                addresses[address] = value.data_ptr()
                lengths[length] = entries // width
            elif value is None and dtype is not None:
                addresses[address] = lengths[length] = 0
            else:
                setattr(self.structure, name, value)


def _place(structure: Any, name: str, declared: Any) -> tuple[str, torch.dtype | None, int, int, int]:
    """Name of a parameter, and where the address and the length of an array are; writes what an array always has.

    Second and third are the type of an array's scalars, None for another parameter, and the number of scalars of an
    item of the array.
    """
    if not isinstance(declared, wp.array):
        return name, None, 1, 0, 0
    dtype = wp.dtype_to_torch(getattr(declared.dtype, "_wp_scalar_type_", declared.dtype))
    array, width = getattr(structure, name), wp.types.type_size(declared.dtype)
    array.ndim, array.strides[0] = 1, width * dtype.itemsize
    begin = getattr(type(structure), name).offset
    address, length = begin + type(array).data.offset, begin + type(array).shape.offset
    return name, dtype, width, address // ADDRESS, length // LENGTH
