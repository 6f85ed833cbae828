"""Killed at any moment of writing, a sweep continues to the same table and repeats nothing that was finished."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest


@pytest.mark.slow
def test_a_sweep_killed_at_any_write_ends_with_the_same_table(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "bench.kill_everywhere", str(tmp_path)]
    done = subprocess.run(command, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert len(report["table"]) == 2
    assert report["events"] > 30
    for killed in report["killed"]:
        assert killed["survived"] == 0, f"event {killed['deadly']} did not kill"
        assert killed["repeated"] == [], f"killed at event {killed['deadly']}"
        assert killed["same"], f"killed at event {killed['deadly']}"
        assert killed["left"] == [], f"killed at event {killed['deadly']}"
        assert not killed["aside"], f"killed at event {killed['deadly']}"


def killed_at_random(folder: Path, kills: int, processes: int) -> dict[str, Any]:
    command = [sys.executable, "-m", "bench.kill_at_random", str(folder), str(kills), str(processes)]
    done = subprocess.run(command, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    report: dict[str, Any] = json.loads(done.stdout)
    return report


@pytest.mark.parametrize(
    ("kills", "processes"),
    [
        (8, 1),
        (8, 2),
        pytest.param(50, 1, marks=pytest.mark.slow),
        pytest.param(100, 2, marks=pytest.mark.slow),
    ],
)
def test_no_finished_cell_is_lost_or_run_again_by_random_kills(kills: int, processes: int, tmp_path: Path) -> None:
    """From outside, at any moment; with two processes, each dies at its own while the other one works on."""
    report = killed_at_random(tmp_path, kills, processes)
    assert report["cells"] == 10
    assert report["kills"] >= kills
    for number, sweep in enumerate(report["sweeps"]):
        assert set(sweep["codes"]) == {0}, f"sweep {number}"
        assert sweep["repeated"] == [], f"sweep {number}"
        assert sweep["unreadable"] == [], f"sweep {number}"
        assert sweep["left"] == [], f"sweep {number}"
        assert sweep["same"], f"sweep {number}"
        assert not sweep["aside"], f"sweep {number}"
