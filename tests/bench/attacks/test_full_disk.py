"""Where the disk is full a sweep stops and says so; with room again, it ends with the table of an undisturbed one."""

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from bench.full_disk import UNSHARE, why_nothing_can_be_mounted


def tried(folder: Path, what: str, within: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Run the sweep under every size; what holds at each of them is asserted here."""
    command = [*within, sys.executable, "-m", "bench.full_disk", str(folder), what]
    done = subprocess.run(command, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["cells"] == 5
    attempts: list[dict[str, Any]] = report["tried"]
    for attempt in attempts:
        stopped = attempt["said"].startswith("StoreError: no space left to write ")
        assert stopped or attempt is attempts[-1], attempt
        assert not stopped or "run the same command again" in attempt["said"]
        assert attempt["again"] == "done", attempt
        assert attempt["same"], attempt
        assert attempt["unreadable"] == attempt["left"] == attempt["repeated"] == [], attempt
        assert not attempt["aside"], attempt
    return attempts


@pytest.mark.slow
def test_a_full_disk_stops_the_sweep_and_loses_nothing(tmp_path: Path) -> None:
    reason = why_nothing_can_be_mounted(tmp_path)
    if reason is not None:
        pytest.skip(reason)
    attempts = tried(tmp_path, "space", UNSHARE)
    assert {attempt["finished"] for attempt in attempts} == {0, 1, 2, 3, 4, 5}


@pytest.mark.slow
def test_files_that_may_not_grow_stop_the_sweep_and_lose_nothing(tmp_path: Path) -> None:
    """Needs no rights; the kernel refuses in the middle of a file."""
    attempts = tried(tmp_path, "size")
    assert len(attempts) > 4
