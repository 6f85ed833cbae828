"""The text of native snippets: files of C++ beside the modules that use them, specialised for each kernel.

A file ``NAME.inl`` has sections, which are bodies of functions or parts of them. SCALAR, ON_CUDA and words that the
module defines are replaced for each kernel. Messages of the compiler name the file and its line.
"""

import re
from collections.abc import Mapping
from importlib.resources import files

import torch

from .runtime import scalar_type

_SECTION = re.compile(r"// ---- (\w+)")
_INCLUDE = re.compile(r'#include "([\w.:]+)"')


def native_file(package: str, name: str, **others: Mapping[str, str]) -> dict[str, str]:
    """The sections of the file ``name`` in a package, by their names.

    A section extends from its line ``// ---- name`` to the next such line. A line ``#include "name"`` is replaced by
    an earlier section of the file, and ``#include "lanes.inl:name"`` by a section of another file, which is passed as
    ``lanes=``.
    """
    lines = files(package).joinpath(name).read_text(encoding="utf-8").splitlines()
    known = {f"{file}.inl:{section}": text for file, sections in others.items() for section, text in sections.items()}
    sections: dict[str, str] = {}
    for number, line in enumerate(lines, start=1):
        if heading := _SECTION.fullmatch(line):
            section = heading[1]
            sections[section] = f'\n#line {number + 1} "{name}"\n'
        elif sections and (include := _INCLUDE.fullmatch(line)):
            sections[section] += f'{(known | sections)[include[1]]}#line {number + 1} "{name}"\n'
        elif sections:
            sections[section] += f"{line}\n"
    return sections


_STAND_INS = native_file(__package__, "native_text.inl")["stand_ins"]


def native_text(snippet: str, dtype: torch.dtype, on_cuda: bool, words: Mapping[str, str]) -> str:
    """A native snippet for one scalar type and one division of work, with its ``words`` replaced.

    ``dtype`` replaces SCALAR. ``on_cuda``, which replaces ON_CUDA (1 or 0), tells whether work is divided as on CUDA
    (see ``as_on_cuda``); such a snippet also compiles for the CPU, where CUDA's intrinsics have substitutes.
    """
    text = _STAND_INS + snippet if on_cuda else snippet
    for word, meaning in {
        "SCALAR": f"wp::{scalar_type(dtype).__name__}",
        "ON_CUDA": str(int(on_cuda)),
        **words,
    }.items():
        text = text.replace(word, meaning)
    return text + '#line 1 "generated"\n'
