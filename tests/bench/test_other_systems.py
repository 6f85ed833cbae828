"""What only Linux has is not needed: with it hidden, files are read, cores are counted and memory is known."""

import io
import os
import resource
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from radiogs_bench.cli.device import usable_cores
from radiogs_bench.kernel_bench import clock
from radiogs_bench.rehearsal import limits
from radiogs_bench.store import provenance
from radiogs_core.errors import DataError, UsageError
from radiogs_datasets.image_files import read_exr, write_exr
from radiogs_datasets.jpeg_decoding import decode_jpeg

CPU = torch.device("cpu")


@pytest.fixture(autouse=True)
def elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("sched_getaffinity", "memfd_create", "MFD_CLOEXEC", "process_cpu_count"):
        monkeypatch.delattr(os, name, raising=False)
    for module, names in (
        (provenance, ("CPU_INFORMATION", "PROCESS_STATUS", "PEAK_RESET")),
        (limits, ("MEMORY_INFORMATION", "PROCESS_STATUS")),
        (clock, ("STATUS", "CLEAR_PEAK")),
    ):
        for name in names:
            monkeypatch.setattr(module, name, tmp_path / "nowhere" / name)


def test_exr_files_are_read(tmp_path: Path) -> None:
    image = np.random.default_rng(1).random((5, 7, 3)).astype(np.float16).astype(np.float32)
    write_exr(tmp_path / "map.exr", image)
    assert (read_exr(tmp_path / "map.exr") == image).all()


def test_jpegs_are_read_and_damage_is_heard() -> None:
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


def test_rehearsals_know_what_memory_there_is() -> None:
    installed = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    assert limits.memory_there(CPU)["host"] == pytest.approx(installed, rel=0.01)
    assert limits.in_use(CPU)["host"] > 50e6


def test_what_cannot_be_measured_is_said() -> None:
    with pytest.raises(UsageError, match="peak memory cannot be measured here"):
        clock.peak_bytes(lambda: None, CPU)
