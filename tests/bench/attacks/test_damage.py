"""Damaged, half-written and refused files: by flipped bytes, random damage, a full disk, and kills at any moment."""

import json
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from bench import fuzz
from bench.flips import finished, flips
from bench.full_disk import UNSHARE, why_nothing_can_be_mounted
from radiogs_datasets import load_scene


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    finished(folder)
    return folder


@pytest.mark.parametrize("count", [240, pytest.param(2000, marks=pytest.mark.slow)])
def test_every_changed_byte_is_noticed_when_it_is_read(count: int, run: Path) -> None:
    """Audit M6 and L: of 106 changed cells 23 silently gave another value, and 3 a traceback."""
    found = flips(run, count, seed=1)
    assert sum(counts.total() for counts in found.values()) == count
    for kind, counts in found.items():
        assert not counts["silent"], kind
        assert not counts["unexpected"], kind
        assert counts["seen"] > counts["harmless"], kind


@pytest.mark.parametrize("count", [40, pytest.param(2000, marks=pytest.mark.slow)])
def test_a_damaged_scene_is_never_read_as_another_scene(count: int) -> None:
    found = fuzz.scenes(count, 1)
    assert {kind: found[kind] for kind in fuzz.WRONG} == dict.fromkeys(fuzz.WRONG, 0)
    assert found["refused"] > count / 4
    assert found["as before"] + found["as it says"] > 0


def test_no_damaged_suite_ends_in_an_error_that_is_not_explained() -> None:
    found = fuzz.suites(500, 1)
    assert {kind: found[kind] for kind in fuzz.WRONG} == dict.fromkeys(fuzz.WRONG, 0)
    assert found["refused"] > 100


def test_the_second_reading_sees_another_camera_and_another_image(tmp_path: Path) -> None:
    """The outcome "silent" of the judge does occur."""
    folder = fuzz.small_scene(tmp_path / "corner")
    scene = load_scene(str(folder))
    assert fuzz.agrees(folder, scene)
    path = folder / "transforms_test.json"
    whole = path.read_text()
    for change in ({"camera_angle_x": 0.5}, {"frames": json.loads(whole)["frames"][:1]}):
        path.write_text(json.dumps(json.loads(whole) | change))
        assert not fuzz.agrees(folder, scene)
    table = json.loads(whole)
    table["frames"][0]["transform_matrix"][0][3] += 0.1
    path.write_text(json.dumps(table))
    assert not fuzz.agrees(folder, scene)
    path.write_text(whole)
    shutil.copy(folder / "train_000" / "rgba.png", folder / "train_001" / "rgba.png")
    assert not fuzz.agrees(folder, load_scene(str(fuzz.small_scene(tmp_path / "other"))))


def tried(folder: Path, what: str, within: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Run the sweep at every size; properties that hold at each size are asserted here."""
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
    [(8, 1), (8, 2), pytest.param(50, 1, marks=pytest.mark.slow), pytest.param(100, 2, marks=pytest.mark.slow)],
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
