"""Runs kernels from their PTX on the CPU: the machine, compiled once by g++, and what it is given for a launch."""

import ctypes
import hashlib
import os
import re
import shutil
import subprocess
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from ptx.operations import MEETINGS, cases
from ptx.parse import BASES, Program

SOURCE = Path(__file__).with_name("machine.cpp")
KINDS = ("race", "misaligned", "outside", "meeting")
"""Faults: bytes that two threads use without an atomic, addresses that do not suit their type or lie in no allocation,
and lanes that wait in vain."""

FLAGS = (
    "-std=c++17", "-O3", "-shared", "-fPIC", "-ffp-contract=off", "-frounding-math", "-fwrapv", "-fno-strict-aliasing",
)  # fmt: skip


def kept_folder() -> Path:
    """Where the machine and kernels' PTX are kept: in Warp's cache, so that all processes compile them once."""
    wp.init()
    folder = Path(str(wp.config.kernel_cache_dir)) / "ptx"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@cache
def machine() -> ctypes.CDLL:
    """The machine, kept by the digest of its text. Skips without g++, but fails in CI."""
    compiler = shutil.which("g++")
    if compiler is None:
        (pytest.fail if os.environ.get("CI") else pytest.skip)("g++ is not installed")
    parts = {
        "machine.cpp": SOURCE.read_text(encoding="utf-8"),
        "cases.inc": "".join(f"case {number}: {{ {case.text} break; }}\n" for number, case in enumerate(cases())),
        "meetings.inc": ", ".join(name.replace(".", "_").upper() for name in MEETINGS),
    }
    kept = kept_folder() / f"machine-{hashlib.sha256(repr((parts, FLAGS)).encode()).hexdigest()[:16]}"
    if not (library := kept / "machine.so").exists():
        kept.mkdir(parents=True, exist_ok=True)
        for name, text in parts.items():
            kept.joinpath(name).write_text(text, encoding="utf-8")
        made = kept / f"{os.getpid()}.so"
        subprocess.run([compiler, *FLAGS, str(kept / "machine.cpp"), "-o", str(made)], check=True)
        made.replace(library)
    return ctypes.CDLL(str(library))


class _Program(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("code", "constants", "parameters", "static")),
        *((name, ctypes.c_int32) for name in ("count", "slots", "local", "shared", "constant", "meets")),
    )


class _Report(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_int32) for name in ("kind", "instruction", "thread", "other")),
        ("address", ctypes.c_uint64),
    )


class _Account(ctypes.Structure):
    _fields_ = (
        ("found", ctypes.c_int64 * len(KINDS)),
        *((name, ctypes.c_int64) for name in ("atomics", "bytes", "instructions")),
        ("reports", _Report * 8),
    )


@dataclass
class Account:
    """Operations of launches, and the faults that were found in them."""

    atomics: Counter[str] = field(default_factory=Counter)
    """Atomic operations by the kernel's name."""
    bytes: int = 0
    """Bytes of global memory that were read, written and changed, each access counted."""
    instructions: int = 0
    kernels: Counter[str] = field(default_factory=Counter)
    """Launches by the kernel's name."""
    found: Counter[str] = field(default_factory=Counter)
    """Faults by their kind; ``order``: launches whose result depends on the order of threads."""
    reports: list[str] = field(default_factory=list)
    """The first faults of each launch."""


class Executable:
    """A program, ready for the machine."""

    def __init__(self, program: Program, name: str) -> None:
        self.program, self.name, self.machine = program, name, machine()
        self.adds_floats = any(re.search(r"(atom|red)\..*add\.f\d+ ", each.text) for each in program.code)
        """Whether sums round in the order of its threads."""
        rows = [(each.operation, each.guard, each.negated, *each.operands) for each in program.code]
        self.code = np.array(rows, np.int32)
        kind = np.dtype([("value", np.uint64), ("base", np.int32), ("slot", np.int32)])
        listed = [(value, BASES.index(base), slot) for (value, base), slot in program.constants.items()]
        self.constants = np.array(listed, kind)
        self.parameters = np.zeros(program.spaces["param"] // 8 + 1, np.uint64)
        self.static = np.frombuffer(program.static + bytes(16), np.uint8).copy()

    def execute(
        self,
        values: Sequence[bytes],
        allocations: Sequence[tuple[int, int]],
        threads: tuple[int, int],
        seed: int,
        account: Account,
    ) -> None:
        """Run blocks of threads, in an order by ``seed``.

        Args:
            values: The bytes of each parameter.
            allocations: Where memory begins and ends that the kernel may use.
            threads: The number of blocks, and of threads in each.
            account: Is added to.
        """
        room = self.parameters.view(np.uint8)
        for place, value in zip(self.program.parameters, values, strict=True):
            assert place.size == len(value), f"{self.name}: a parameter of {place.size} bytes is given {len(value)}"
            room[place.begin : place.begin + place.size] = np.frombuffer(value, np.uint8)
        spaces, apart = self.program.spaces, np.array(_apart(allocations), np.uint64).reshape(-1, 2)
        arrays = self.code, self.constants, self.parameters, self.static
        sizes = len(self.constants), self.program.slots, spaces["local"], spaces["shared"], len(self.program.static)
        given, found = _Program(*(each.ctypes.data for each in arrays), *sizes, int(self.program.meets)), _Account()
        where = ctypes.c_void_p(apart.ctypes.data)
        size = [ctypes.c_int(number) for number in (len(apart), *threads, seed)]
        self.machine.execute(ctypes.byref(given), where, *size, ctypes.byref(found))
        self._add(account, found)

    def execute_twice(
        self,
        values: Sequence[bytes],
        allocations: Sequence[tuple[int, int]],
        threads: tuple[int, int],
        seed: int,
        account: Account,
    ) -> None:
        """As ``execute``, and then from the same memory in another order, which must not compute other bits."""
        before = _contents(allocations)
        self.execute(values, allocations, threads, seed, account)
        after = _contents(allocations)
        for (begin, _), content in zip(allocations, before, strict=True):
            ctypes.memmove(begin, content, len(content))
        self.execute(values, allocations, threads, seed + 1, Account())
        if _contents(allocations) != after:
            account.found["order"] += 1
            account.reports.append(f"{self.name}: the order of its threads changes what it computes")

    def _add(self, account: Account, found: _Account) -> None:
        account.atomics[self.name] += found.atomics
        account.bytes += found.bytes
        account.instructions += found.instructions
        for kind, number in zip(KINDS, found.found, strict=True):
            account.found[kind] += number
        for each in found.reports[: sum(found.found)]:
            other = f" and {each.other}" if each.other >= 0 else ""
            what = f"{KINDS[each.kind]} at {each.address:#x} of threads {each.thread}{other}"
            account.reports.append(f"{self.name}: {what}: {self.program.code[each.instruction].text}")


def _contents(allocations: Sequence[tuple[int, int]]) -> list[bytes]:
    return [ctypes.string_at(begin, end - begin) for begin, end in allocations]


def _apart(allocations: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """The allocations in order, overlapping ones merged."""
    merged: list[tuple[int, int]] = []
    for begin, end in sorted(allocations):
        if merged and begin < merged[-1][1]:
            merged[-1] = merged[-1][0], max(end, merged[-1][1])
        elif begin < end:
            merged.append((begin, end))
    return merged
