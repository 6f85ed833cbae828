"""The text of native snippets: files of C++ beside the modules that use them, specialised for each kernel.

A file ``NAME.inl`` has sections, which are bodies of functions or parts of them. SCALAR, ON_CUDA and words that the
module defines are replaced for each kernel. Messages of the compiler name the file and its line.
"""

import re
from collections.abc import Mapping
from importlib.resources import files
from typing import NamedTuple

import torch

from .runtime import scalar_type

_SECTION = re.compile(r"// ---- (\w+)")
_INCLUDE = re.compile(r'#include "([\w.:]+)"')


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


_STAND_INS = native_file(__package__, "native_text.inl").sections["stand_ins"]


def native_text(snippet: str, dtype: torch.dtype, on_cuda: bool, words: Mapping[str, object]) -> str:
    """A native snippet for one scalar type and one division of work, with its ``words`` replaced.

    ``dtype`` replaces SCALAR. ``on_cuda``, which replaces ON_CUDA (1 or 0), tells whether work is divided as on CUDA
    (see ``as_on_cuda``); such a snippet also compiles for the CPU, where CUDA's intrinsics have substitutes.
    """
    text = _STAND_INS + snippet if on_cuda else snippet
    for word, meaning in {"SCALAR": f"wp::{scalar_type(dtype).__name__}", "ON_CUDA": int(on_cuda), **words}.items():
        text = text.replace(word, str(meaning))
    return text + '#line 1 "generated"\n'
