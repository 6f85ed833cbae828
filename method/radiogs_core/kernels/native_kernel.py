"""Makes kernels of native snippets: a kernel runs a section of a file for each item, with parameters listed once."""

import linecache
from collections.abc import Mapping
from typing import Any, NamedTuple

import torch
import warp as wp

from .native_text import NativeFile, native_text
from .runtime import scalar_type, start_warp

INTEGERS, LONGS, DOUBLES = wp.array(dtype=wp.int32), wp.array(dtype=wp.int64), wp.array(dtype=wp.float64)
"""Types of arrays whatever the scalar type, by their items: int32, int64 and float64."""

BYTES, SIGNS, FLAGS = wp.array(dtype=wp.uint8), wp.array(dtype=wp.int8), wp.array(dtype=wp.bool)
"""Further types of arrays: uint8, int8 and bool."""


def flat(dtype: torch.dtype) -> Any:
    """The type of an array of scalars, float32 or float64."""
    return wp.array(dtype=scalar_type(dtype))


class Pair(NamedTuple):
    """A kernel, and the kernel of its gradients."""

    forward: wp.Kernel
    backward: wp.Kernel


def native_kernel(
    file: NativeFile,
    dtype: torch.dtype,
    options: Mapping[str, Any],
    section: str,
    item: str,
    *parameters: tuple[Any, str],
    on_cuda: bool = False,
    words: Mapping[str, object] | None = None,
) -> wp.Kernel:
    """The kernel that runs a section of a file for each item; see ``runtime.launch``.

    Args:
        file: The file of the section.
        dtype: The scalar type, SCALAR in the section.
        options: Options of the kernel's Warp module, such as ``runtime.NATIVE``.
        section: Name of the section.
        item: Name of the item's number in the section.
        parameters: The section's other parameters in the order of a launch's arguments: types, each with the names of
            its parameters, separated by spaces.
        on_cuda: Whether work is divided as on CUDA.
        words: Further words of the section, by which values they are replaced.
    """
    start_warp()
    types = {name: kind for kind, names in parameters for name in names.split()}
    name, listed = f"{file.name.removesuffix('.inl')}_{section}", ", ".join(types)
    stub = _function(f"def {name}_item({item}, {listed}): ...", {item: wp.int32, **types})
    of_item = wp.func_native(native_text(file.sections[section], dtype, on_cuda, words or {}))(stub)
    body = f"def {name}(first, {listed}):\n    of_item(first + wp.tid(), {listed})"
    kernel = _function(body, {"first": wp.int32, **types}, of_item=of_item)
    return wp.kernel(enable_backward=False, module="unique", module_options={**options})(kernel)


def _function(source: str, types: Mapping[str, Any], **known: Any) -> Any:
    """The function that ``source`` defines, which knows Warp and ``known`` names; Warp reads it from ``linecache``."""
    name = source.partition("(")[0].removeprefix("def ")
    place, names = f"<{name}>", {"__name__": __name__, "wp": wp, **known}
    linecache.cache[place] = len(source), None, source.splitlines(keepends=True), place
    exec(compile(source, place, "exec"), names)
    names[name].__annotations__ = {**types}
    return names[name]
