"""The harness works without what only Linux has: files are read, cores counted, peaks known."""

import ast
import io
import os
import resource
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from radiogs_bench.device import usable_cores
from radiogs_bench.lab.kernels import clock
from radiogs_bench.store import provenance
from radiogs_core.errors import DataError, UsageError
from radiogs_datasets.image_files import decode_jpeg, read_exr, write_exr

CPU = torch.device("cpu")
ROOT = Path(__file__).parents[3]

OF_LINUX = {
    "copy_file_range", "eventfd", "fdatasync", "getrandom", "getxattr", "memfd_create", "pidfd_open", "posix_fadvise",
    "posix_fallocate", "process_cpu_count", "sched_getaffinity", "sched_setaffinity", "setns", "setxattr", "splice",
    "unshare", "O_DIRECT", "O_NOATIME", "O_PATH", "O_TMPFILE", "MFD_CLOEXEC", "pidfd_send_signal", "prctl",
}  # fmt: skip
"""Names of ``os`` and ``signal`` that macOS lacks."""

HIDDEN = {
    "memfd_create", "MFD_CLOEXEC", "process_cpu_count", "sched_getaffinity",
}  # fmt: skip
PLACES = {provenance: ("CPU_INFORMATION", "PROCESS_STATUS", "PEAK_RESET")}
"""Constants that name files of ``/proc``, by module."""


@pytest.fixture(autouse=True)
def elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in HIDDEN:
        monkeypatch.delattr(os, name, raising=False)
    for module, names in PLACES.items():
        for name in names:
            monkeypatch.setattr(module, name, tmp_path / "nowhere" / name)


@pytest.mark.slow
def test_nothing_else_of_linux_alone_is_used() -> None:
    """Every use in the sources is among what these tests hide."""
    used, named = set(), set()
    for package in ("radiogs_bench", "method", "datasets", "baselines", "reports"):
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Attribute) and node.attr in OF_LINUX:
                    used.add(node.attr)
                if isinstance(node, ast.Call) and ast.unparse(node.func) == "Path":
                    named |= {path for each in node.args if ast.unparse(each).startswith("'/proc")}
    assert used == HIDDEN - {"process_cpu_count"}
    assert named == {Path(str(module.__file__)) for module in PLACES}


def test_exr_files_are_read(tmp_path: Path) -> None:
    image = np.random.default_rng(1).random((5, 7, 3)).astype(np.float16).astype(np.float32)
    write_exr(tmp_path / "map.exr", image)
    assert (read_exr(tmp_path / "map.exr") == image).all()


def test_jpegs_are_read_and_damaged_ones_are_refused() -> None:
    packed = io.BytesIO()
    Image.fromarray(np.full((32, 32, 3), 90, np.uint8)).save(packed, "JPEG")
    data = packed.getvalue()
    assert decode_jpeg(Path("a.jpg"), data).shape == (32, 32, 3)
    with pytest.raises(DataError, match="libjpeg says"):
        decode_jpeg(Path("a.jpg"), data[:-20] + b"\xff\xd9")


def test_cores_are_counted() -> None:
    assert usable_cores() == os.cpu_count()


def test_the_record_of_a_process_is_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    provenance.reset_peaks(CPU)
    made = provenance.session(CPU)
    assert made["machine"]["cpu"]
    assert made["peak_memory_bytes"]["host"] > 50e6
    monkeypatch.setattr(sys, "platform", "darwin")  # counts bytes where Linux counts kibibytes
    assert provenance.resident_peak() == resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def test_peak_memory_is_refused_where_the_system_does_not_say_it() -> None:
    with pytest.raises(UsageError, match="peak memory cannot be measured here"):
        clock.peak_bytes(lambda: None, CPU)
