"""Kernels of native snippets: a kernel runs a section of a C++ file for each item, with parameters listed once.

A file ``NAME.inl`` beside the module that launches its kernels has sections, which are bodies of functions or parts of
them. SCALAR, ON_CUDA and words that the module defines are replaced for each kernel. Messages of the compiler name the
file and its line.
"""

import linecache
import re
from collections.abc import Mapping
from importlib.resources import files
from typing import Any, NamedTuple

import torch
import warp as wp

from .runtime import scalar_type, start_warp

_SECTION = re.compile(r"// ---- (\w+)")
_INCLUDE = re.compile(r'#include "([\w.:]+)"')


def array_of(items: Any) -> Any:
    """The type of an array, by the type of its items."""
    return wp.array(dtype=items)


def flat(dtype: torch.dtype) -> Any:
    """The type of an array of scalars, float32 or float64."""
    return array_of(scalar_type(dtype))


INTEGERS, LONGS, DOUBLES = array_of(wp.int32), array_of(wp.int64), array_of(wp.float64)
"""Types of arrays whatever the scalar type: of int32, int64 and float64."""

BYTES, SIGNS, FLAGS = array_of(wp.uint8), array_of(wp.int8), array_of(wp.bool)
"""Further types of arrays: of uint8, int8 and bool."""


class Pair(NamedTuple):
    """A kernel, and the kernel of its gradients."""

    forward: wp.Kernel
    backward: wp.Kernel


class NativeFile(NamedTuple):
    """A file of native snippets."""

    name: str
    """Its name."""
    sections: Mapping[str, str]
    """Its sections by their names."""


def native_file(package: str, name: str, *others: NativeFile) -> NativeFile:
    """The file ``name`` in a package.

    A section extends from its line ``// ---- name`` to the next such line. A line ``#include "name"`` is replaced by
    an earlier section of the file, and ``#include "lanes.inl:name"`` by a section of one of the ``others``.
    """
    lines = files(package).joinpath(name).read_text(encoding="utf-8").splitlines()
    known = {f"{other.name}:{section}": text for other in others for section, text in other.sections.items()}
    sections: dict[str, str] = {}
    for number, line in enumerate(lines, start=1):
        if heading := _SECTION.fullmatch(line):
            section = heading[1]
            sections[section] = f'\n#line {number + 1} "{name}"\n'
        elif sections and (include := _INCLUDE.fullmatch(line)):
            sections[section] += f'{(known | sections)[include[1]]}#line {number + 1} "{name}"\n'
        elif sections:
            sections[section] += f"{line}\n"
    return NativeFile(name, sections)


_STAND_INS = native_file(__package__, "stand_ins.inl")


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
        dtype: The scalar type, which replaces SCALAR.
        options: Options of the kernel's Warp module, such as ``runtime.NATIVE``.
        section: Name of the section.
        item: Name of the item's number in the section.
        parameters: The section's other parameters in the order of a launch's arguments: types, each with the names of
            its parameters, separated by spaces.
        on_cuda: Whether work is divided as on CUDA (see ``as_on_cuda``), which replaces ON_CUDA by 1 or 0.
        words: Further words of the section, and the values that replace them.
    """
    start_warp()
    types = {name: kind for kind, names in parameters for name in names.split()}
    name, listed = f"{file.name.removesuffix('.inl')}_{section}", ", ".join(types)
    stub = _function(f"def {name}_item({item}, {listed}): ...", {item: wp.int32, **types})
    of_item = wp.func_native(_written(file.sections[section], dtype, on_cuda, words or {}))(stub)
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


def _written(snippet: str, dtype: torch.dtype, on_cuda: bool, words: Mapping[str, object]) -> str:
    """A snippet with its words replaced; see ``native_kernel``.

    A snippet that is arranged for CUDA also compiles for the CPU, where CUDA's intrinsics have substitutes.
    """
    text = _STAND_INS.sections["stand_ins"] + snippet if on_cuda else snippet
    for word, meaning in {"SCALAR": f"wp::{scalar_type(dtype).__name__}", "ON_CUDA": int(on_cuda), **words}.items():
        text = text.replace(word, str(meaning))
    return text + '#line 1 "generated"\n'
