"""Two workers do nearly twice the work of one, as far as the machine lets two processes, and the very same work."""

import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from radiogs_bench.runs.sweep import read_sweep
from radiogs_bench.store.folder import Store, product_name

CPU = torch.device("cpu")
SEEDS = 4
MEASURED = ("seconds", "parts", "sessions", "timings", "seal")
"""Entries that no two runs share; the seal covers them."""

SUITE = """
name = "long-cells"
title = "Cells that take a while"
reference = "ours"
columns = ["nvs/psnr"]
[[rows]]
key = "ours"
text = "Ours"
budget = { geometry.steps = 3, inverse_iterations = 9 }
"""


class Run:
    """A run in the background; ``span`` is when its first cell was started and when its last was done.

    Start-up (imports, compiled kernels) and reports lie outside of it: they do not grow with the number of cells.
    """

    def __init__(self, suite: Path, out: Path, *further: str) -> None:
        command = [sys.executable, "-m", "radiogs_bench", "run", str(suite), "--preset", "smoke", "--seeds", str(SEEDS)]
        self.process = subprocess.Popen(
            [*command, "--out", str(out), *further],
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        self.lines: list[tuple[float, str]] = []
        self.reader = threading.Thread(target=self._read)
        self.reader.start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        with self.process.stderr as lines:
            self.lines.extend((time.perf_counter(), line) for line in lines)

    def span(self) -> tuple[float, float]:
        self.reader.join()
        assert self.process.wait() == 0, "".join(line for _, line in self.lines)
        started = [when for when, line in self.lines if line.endswith(": started\n")]
        done = [when for when, line in self.lines if re.search(r": done in [\d.]+ s\n$", line)]
        return min(started), max(done)


def seconds_of(*runs: Run) -> float:
    """From the first cell's start to the last one's end."""
    spans = [run.span() for run in runs]
    return max(end for _, end in spans) - min(begin for begin, _ in spans)


def contents(folder: Path) -> dict[str, tuple[Any, dict[str, bytes], list[bytes]]]:
    """Every cell's result without what is measured, its arrays, and its model, bit for bit."""
    store, found = Store(folder), {}
    for result in store.results():
        (place,) = [each for each in read_sweep(folder)["cells"] if each["key"] == result["key"]]
        with np.load(store.arrays_path(result["key"])) as arrays:
            maps = {name: arrays[name].tobytes() for name in arrays.files}
        model = store.tensors(product_name(place["stages"][-1]), CPU)
        surfels = [value.numpy().tobytes() for value in model["product"]["surfels"].values()]
        said: dict[str, Any] = {name: value for name, value in result.items() if name not in MEASURED}
        said["trail"] = {
            stage: [{name: value for name, value in point.items() if name not in MEASURED} for point in points]
            for stage, points in result["trail"].items()
        }
        found[result["key"]] = (said, maps, surfels)
    return found


@pytest.mark.slow
@pytest.mark.alone
def test_two_workers_do_nearly_twice_the_work_and_the_same(tmp_path: Path) -> None:
    """85 % of what two processes without a pool get done here: 1.7 times one, where two get twice as much done."""
    suite = tmp_path / "long.toml"
    suite.write_text(SUITE)
    folders = {name: tmp_path / name for name in ("one", "first half", "second half", "pool")}
    one = seconds_of(Run(suite, folders["one"], "--threads", "1"))
    halves = [
        Run(suite, folders[f"{name} half"], "--threads", "1", "--shard", f"{part}/2")
        for part, name in enumerate(("first", "second"))
    ]
    apart = seconds_of(*halves)
    pool = seconds_of(Run(suite, folders["pool"], "--threads", "2", "--workers", "2"))
    load = os.getloadavg()[0]
    said = f"one {one:.1f} s, two apart {one / apart:.2f}, pool {one / pool:.2f} times as fast; load {load:.1f}"
    print(said)  # noqa: T201
    assert one / pool >= 0.85 * min(2.0, one / apart), said
    expected = contents(folders["one"])
    assert len(expected) == SEEDS
    assert contents(folders["pool"]) == expected
