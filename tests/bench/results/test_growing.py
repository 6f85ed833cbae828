"""The reports of a run over several scenes grow while it goes on, and change nothing about how it ends."""

import io
import json
import subprocess
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bench.fake_method import SCENE, FakeSweep, asked, fake_cell, place_of, scene_of
from radiogs_bench.child_process import CHILD
from radiogs_bench.cli import child, main
from radiogs_bench.errors import CellFailed, StoreError
from radiogs_bench.results import growing as module
from radiogs_bench.results.growing import FIRST_SECONDS, PAUSE, GrowingReports
from radiogs_bench.runs.engines.in_process import Task, record_failure
from radiogs_bench.runs.progress import LogProgress
from radiogs_bench.runs.sweep import CellRef
from radiogs_bench.store.folder import Store
from radiogs_bench.suites import scenes
from scenes import sphere_scene

Started = Callable[..., int]
Command = Callable[[dict[str, Any]], tuple[int, str, str]]


SUITE = """
name = "mine"
title = "Two rows"
reference = "ours"
columns = ["nvs/psnr"]

[[rows]]
key = "ours"
text = "Ours"

[[rows]]
key = "no-rad"
text = "No rad"
variant = { radiometric_weight = 0 }
"""


@pytest.fixture
def two_scenes(fake_run: Started, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Started:
    """``fake_run`` of two rows over scenes ``one`` and ``two``, whose reports grow from the beginning."""

    def named(name: str, **how: Any) -> Any:
        return replace(sphere_scene(views=2, size=16), name=name, checksum=f"{name:0<64}")

    monkeypatch.setattr(scenes, "load_scene", named)
    monkeypatch.setattr(module, "FIRST_SECONDS", 0.0)
    suite = tmp_path_factory.mktemp("suite") / "mine.toml"
    suite.write_text(SUITE)
    return lambda *further: fake_run(str(suite), "--scenes", "one,two", "--seeds", "1", *further)


def commands(monkeypatch: pytest.MonkeyPatch, answer: Command) -> list[Sequence[str]]:
    """The commands that are started from now on, the order of each answered with an exit code, stdout and stderr."""
    started: list[Sequence[str]] = []

    def run(command: Sequence[str], **how: Any) -> "subprocess.CompletedProcess[str]":
        started.append(command)
        code, out, error = answer(json.loads(how["input"]))
        return subprocess.CompletedProcess(command, code, out, error)

    monkeypatch.setattr(module, "subprocess", SimpleNamespace(run=run, TimeoutExpired=subprocess.TimeoutExpired))
    return started


def in_this_process(order: dict[str, Any]) -> tuple[int, str, str]:
    with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as error:
        code = child.report(**order)
    return code, out.getvalue(), error.getvalue()


def reports_in(folder: Path) -> dict[str, bytes]:
    """The bytes of every file of a run but for its cells and stages, by name."""
    found = {path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*")) if path.is_file()}
    return {name: path.read_bytes() for name, path in found.items() if not name.startswith(("cells/", "stages/"))}


def test_a_first_table_comes_with_the_first_scene_and_the_last_is_as_without_it(
    two_scenes: Started, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    so_far: dict[str, bytes] = {}

    def look(order: dict[str, Any]) -> tuple[int, str, str]:
        answer = in_this_process(order)
        so_far.update(reports_in(tmp_path))
        return answer

    started = commands(monkeypatch, look)
    assert two_scenes() == 0
    assert started == [[*CHILD, "report"]]
    assert b"Mean over 1 scene (one) and 1 seed" in so_far["mine.md"]
    assert b"1 of the run's 2 scenes are left out" in so_far["mine.md"]
    assert b"Figures, images and surfels are left out" in so_far["report.html"]
    assert b"<dd>2 of 2 finished</dd>" in so_far["report.html"]
    out, error = capsys.readouterr()
    lines = error.splitlines()
    in_order = [
        "one: complete, 1 of 2 scenes",
        next(line for line in lines if "Two rows. Mean over 1 scene (one) and 1 seed" in line),
        f"This is the first table, over 1 of 2 scenes. While the run goes on, {tmp_path}/report.html grows with it.",
        "two ours seed 0: started",
        "two: complete, 2 of 2 scenes",
    ]
    assert [line for line in lines if line in in_order] == in_order
    assert "Two rows. Mean over 2 scenes (one, two) and 1 seed" in out
    assert "first table" not in out
    last = reports_in(tmp_path)
    for name in last.keys() - {"sweep.json"}:
        (tmp_path / name).unlink()
    assert main(["report", str(tmp_path)]) == 0
    assert reports_in(tmp_path) == last


def test_reports_that_cannot_be_written_do_not_end_the_run(
    two_scenes: Started, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    commands(monkeypatch, lambda order: (6, "", "error: no space left to write it\n(exit code 6)\n"))
    assert two_scenes("--json") == 0
    out, _ = capsys.readouterr()
    said = "the reports over 1 of 2 scenes were not written, and the run goes on: no space left to write it"
    assert f'{{"event": "message", "text": "{said}"}}' in out.splitlines()
    assert out.count('"state": "finished", "new": true') == 4


@pytest.mark.parametrize("failure", [OSError(12, "out of memory"), subprocess.TimeoutExpired("report", 1.0)])
def test_a_report_that_does_not_start_or_end_is_an_error_with_a_message(
    failure: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(order: dict[str, Any]) -> tuple[int, str, str]:
        raise failure

    commands(monkeypatch, fail)
    with pytest.raises(StoreError, match=r"could not be begun: out of memory|were ended"):
        module.reported(tmp_path, ["one"], None)


class Growing:
    """Growing reports over scenes of two cells each, written by a function that takes 10 s by the test's own clock."""

    def __init__(self, folder: Path, scenes: str) -> None:
        self.store, self.now = Store(folder), 0.0
        self.keys = {scene: [f"{scene}{row}" for row in "01"] for scene in scenes}
        refs = [
            CellRef(row=key[1], scene=scene, seed=0, key=key, stages=[]) for scene in scenes for key in self.keys[scene]
        ]
        self.over: list[str] = []
        self.made = GrowingReports(LogProgress(), self.store, refs, self.write, clock=lambda: self.now)

    def write(self, scenes: Sequence[str]) -> str:
        self.now += 10.0
        self.over.append("".join(scenes))
        return "a table"

    def end(self, key: str) -> None:
        """A cell ends."""
        for kind in ("json", "npz"):
            path = self.store.folder / "cells" / f"{key}.{kind}"
            path.parent.mkdir(exist_ok=True)
            path.touch()

    def look(self, now: float) -> None:
        """Cells are counted."""
        self.now = now
        self.made.advance("cells", 0, 1)


def test_growing_takes_a_twentieth_of_the_time_and_a_line_a_scene(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = Growing(tmp_path, "abcd")
    run.end("b0")
    run.end("b1")
    run.look(FIRST_SECONDS - 1)
    assert run.over == [], "a run that ends within a minute shows its table at the end"
    run.end("a0")
    run.look(FIRST_SECONDS)
    assert run.over == ["b"]
    run.end("a1")
    run.look(run.now + PAUSE * 10.0 - 1)
    assert run.over == ["b"], "not yet"
    run.look(run.now + 1)
    run.look(run.now + 1000)
    assert run.over == ["b", "ab"], "in the order of the run, and once"
    for key in ("c0", "c1", "d0", "d1"):
        run.end(key)
    run.look(run.now + 1000)
    assert run.over == ["b", "ab"], "the end of the run writes the last one"
    said = capsys.readouterr().err.splitlines()
    assert said.count("a table") == 1
    assert [line for line in said if "complete" in line] == [
        "b: complete, 1 of 4 scenes", "a: complete, 2 of 4 scenes", "c: complete, 4 of 4 scenes",
        "d: complete, 4 of 4 scenes",
    ]  # fmt: skip


def test_a_cell_that_fails_completes_its_scene_and_an_earlier_failure_does_not(tmp_path: Path) -> None:
    fake = FakeSweep(tmp_path)
    cell = fake_cell()
    fails = Task(cell, "fake ours seed 0")
    record_failure(fake.store, fails, CellFailed("an earlier one"))
    refs = [place_of(cell), {**place_of(cell), "scene": "other", "key": "never"}]
    made = GrowingReports(LogProgress(), fake.store, refs, lambda scenes: "", clock=lambda: 0.0)
    assert made.complete == []
    made.advance("cells", 0, 2)
    assert made.complete == []
    record_failure(fake.store, fails, CellFailed("now"))
    made.advance("cells", 1, 2)
    assert made.complete == ["fake"]


def test_runs_of_a_single_scene_and_parts_of_runs_do_not_grow(tmp_path: Path) -> None:
    store, progress, request = Store(tmp_path), LogProgress(), asked()
    assert module.growing(request, store, progress, False) is progress
    scenes = {"fake": SCENE, "other": scene_of("other")}
    assert module.growing(asked(scenes=scenes, shard=(0, 2)), store, progress, False) is progress
    both = asked(scenes=scenes)
    assert isinstance(module.growing(both, store, progress, False), GrowingReports)
