"""Arguments of kernels: writes tensors into memory as the arrays that a kernel or a struct declares.

Types, strides and numbers of axes of the arrays are written once for a kernel, and then only addresses and lengths: a
Warp array for each tensor, or ``wp.launch``, describes and checks all of them for every launch.
"""

import ctypes
import inspect
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple, NoReturn

import torch
import warp as wp

from ..errors import UsageError
from ..instruments import fire

MOST_ENTRIES = 2**31 - 1
"""Largest number of entries of a list, because kernels count entries in 32 bits."""

ADDRESS, LENGTH = 8, 4
"""Bytes of an array's address, and of the length of its axis."""


def require_countable(entries: int, what: str, remedy: str) -> None:
    """Raise UsageError if a list would have more entries than its kernels can count."""
    if entries > MOST_ENTRIES:
        fire(uncountable_lists=1)
        raise UsageError(f"there are {entries} {what}", f"A list holds at most {MOST_ENTRIES} entries.", remedy)


class Parameter(NamedTuple):
    """A parameter of a kernel, or a field of a struct."""

    name: str
    """Its name."""
    dtype: torch.dtype | None
    """Type of the scalars of an array of one axis; None for other parameters."""
    width: int
    """Scalars of an item of the array: 3 for an array of vectors of three."""


class Layout:
    """Where parameters lie in a ctypes structure.

    Args:
        owner: Name of the kernel or struct, for errors.
        kind: Type of the structure. It has a field for each parameter, and may have more.
        parameters: The parameters.
    """

    def __init__(self, owner: str, kind: Any, parameters: Sequence[Parameter]) -> None:
        self.owner, self.kind = owner, kind
        self.names = tuple(parameter.name for parameter in parameters)
        empty = kind()
        self.places = [_place(empty, parameter) for parameter in parameters]
        self.content = bytes(empty) + bytes(-len(bytes(empty)) % ADDRESS)
        """The structure without any arrays, padded to a whole number of addresses."""


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


class Arguments:
    """Values of parameters in memory, as native code reads them.

    ``structure`` is the ctypes structure, ``owner`` the name of its kernel or struct.
    """

    def __init__(self, layout: Layout) -> None:
        memory = bytearray(layout.content)
        self.structure = layout.kind.from_buffer(memory)
        self.owner, self._places = layout.owner, layout.places
        self._addresses, self._lengths = memoryview(memory).cast("Q"), memoryview(memory).cast("i")

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
                # Not hasattr: a vector of Warp takes a microsecond to say that it lacks an attribute.
                setattr(self.structure, name, value.__ctype__() if isinstance(value, DESCRIBED) else value)

    def _refuse(self, tensor: torch.Tensor, name: str, dtype: torch.dtype | None) -> NoReturn:
        gaps = "" if tensor.is_contiguous() else " with gaps"
        takes = f"an array of {dtype}" if dtype else "no tensor"
        raise TypeError(f"'{name}' of {self.owner} takes {takes}, not {tensor.dtype}{gaps}")


class Struct:
    """A Warp struct for kernels, which keeps the tensors alive that its arrays are the memory of.

    Args:
        kind: Type of the struct.
        values: A value for each field: contiguous tensors for arrays, or None. Raises as ``Arguments.write`` does, and
            TypeError if a field is missing or unknown.
    """

    def __init__(self, kind: Any, **values: Any) -> None:
        layout = _layout_of_struct(kind)
        if values.keys() != {*layout.names}:
            raise TypeError(f"{kind.key} has the fields {', '.join(layout.names)}, not {', '.join(values)}")
        self.values = values
        self._arguments = Arguments(layout)
        self._arguments.write([values[name] for name in layout.names])

    def __ctype__(self) -> Any:
        """The struct as native code reads it, under Warp's name for that."""
        return self._arguments.structure


DESCRIBED = (Struct, wp.array)
"""Values that describe themselves to native code."""


@cache
def _layout_of_struct(kind: Any) -> Layout:
    return Layout(kind.key, kind.ctype, [_parameter(name, field.type) for name, field in kind.vars.items()])


def packed(kernel: wp.Kernel, arguments: Sequence[Any]) -> list[Any]:
    """The last arguments of a kernel for ``wp.launch``, contiguous tensors as descriptors of their memory.

    The tensors have to live until the kernel has finished. Raises as ``Arguments.write`` does.
    """
    wanted = parameters_of(kernel)[-len(arguments) :]
    return [
        _described(argument, kernel.key, parameter) if isinstance(argument, torch.Tensor) else argument
        for argument, parameter in zip(arguments, wanted, strict=True)
    ]


def _described(tensor: torch.Tensor, owner: str, parameter: Parameter) -> Any:
    alone = Arguments(_layout_of_array(owner, parameter))
    alone.write([tensor])
    return getattr(alone.structure, parameter.name)


@cache
def _layout_of_array(owner: str, parameter: Parameter) -> Layout:
    kind = type(wp.array(dtype=wp.uint8).__ctype__())
    return Layout(owner, type("Alone", (ctypes.Structure,), {"_fields_": [(parameter.name, kind)]}), [parameter])


@cache
def parameters_of(kernel: wp.Kernel) -> list[Parameter]:
    """The parameters that a kernel declares."""
    declared = inspect.signature(kernel.func).parameters.values()
    return [_parameter(parameter.name, parameter.annotation) for parameter in declared]


def _parameter(name: str, declared: Any) -> Parameter:
    if not isinstance(declared, wp.array) or declared.ndim != 1:
        return Parameter(name, None, 1)
    scalar = getattr(declared.dtype, "_wp_scalar_type_", declared.dtype)
    return Parameter(name, wp.dtype_to_torch(scalar), wp.types.type_size(declared.dtype))
