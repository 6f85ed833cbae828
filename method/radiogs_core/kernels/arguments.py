"""Arguments of kernels: writes tensors into memory as the arrays that a kernel declares.

Types, strides and numbers of axes of the arrays are written once for a kernel, and then only addresses and lengths: a
Warp array for each tensor, or ``wp.launch``, describes and checks all of them for every launch.
"""

import ctypes
import inspect
from collections.abc import Sequence
from typing import Any, NamedTuple, NoReturn

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


class Parameter(NamedTuple):
    """A parameter of a kernel."""

    name: str
    """Its name."""
    dtype: torch.dtype | None
    """Type of the scalars of an array of one axis; None for other parameters."""
    width: int
    """Scalars of an item of the array: 3 for an array of vectors of three."""


class Arguments:
    """Values of a kernel's parameters in memory, as native code reads them.

    Args:
        kernel: Name of the kernel, for errors.
        kind: Type of the ctypes structure that holds them. It has a field for each parameter, and may have more.
        parameters: The parameters.
    """

    def __init__(self, kernel: str, kind: Any, parameters: Sequence[Parameter]) -> None:
        memory = bytearray(-(-ctypes.sizeof(kind) // ADDRESS) * ADDRESS)
        self.kernel, self.structure = kernel, kind.from_buffer(memory)
        self._addresses, self._lengths = memoryview(memory).cast("Q"), memoryview(memory).cast("i")
        self._places = [_place(self.structure, parameter) for parameter in parameters]

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
                    self._refuse(value, name, dtype)
                entries = value.numel()
                if entries > MOST_ENTRIES:
                    require_countable(entries, "entries of an array", "Use fewer surfels, samples or pixels.")
                addresses[address] = value.data_ptr()
                lengths[length] = entries // width
            elif value is None and dtype is not None:
                addresses[address] = lengths[length] = 0
            else:
                setattr(self.structure, name, value)

    def _refuse(self, tensor: torch.Tensor, name: str, dtype: torch.dtype | None) -> NoReturn:
        gaps = "" if tensor.is_contiguous() else " with gaps"
        takes = f"an array of {dtype}" if dtype else "no tensor"
        raise TypeError(f"'{name}' of {self.kernel} takes {takes}, not {tensor.dtype}{gaps}")


def _place(structure: Any, parameter: Parameter) -> tuple[str, torch.dtype | None, int, int, int]:
    """Name, type and width of a parameter, and where its address and length are; writes what an array always has."""
    name, dtype, width = parameter
    if dtype is None:
        return name, dtype, width, 0, 0
    array = getattr(structure, name)
    array.ndim, array.strides[0] = 1, width * dtype.itemsize
    begin = getattr(type(structure), name).offset
    address, length = begin + type(array).data.offset, begin + type(array).shape.offset
    return name, dtype, width, address // ADDRESS, length // LENGTH


def parameters_of(kernel: wp.Kernel) -> list[Parameter]:
    """The parameters that a kernel declares."""
    declared = inspect.signature(kernel.func).parameters.values()
    return [_parameter(parameter.name, parameter.annotation) for parameter in declared]


def _parameter(name: str, declared: Any) -> Parameter:
    if not isinstance(declared, wp.array) or declared.ndim != 1:
        return Parameter(name, None, 1)
    scalar = getattr(declared.dtype, "_wp_scalar_type_", declared.dtype)
    return Parameter(name, wp.dtype_to_torch(scalar), wp.types.type_size(declared.dtype))
