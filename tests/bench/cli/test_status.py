"""Whoever looks on learns which step each cell is at, how fast it goes, and how long the rest will take."""

import json
import os
import pty
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench import fake_method
from bench.fake_method import FakeSweep, asked, fake_cell, write_sweep
from radiogs_bench.cli import main
from radiogs_bench.results.standing import SILENT_AFTER_SECONDS, standing_of
from radiogs_bench.runs.engines.run import OthersProgress
from radiogs_bench.runs.progress import LogProgress
from radiogs_bench.runs.stored_progress import KeptPace
from radiogs_bench.runs.sweep import Sweep, label, read_sweep
from radiogs_bench.store.folder import Store, stage_claim
from radiogs_bench.store.pace import Pace, drop_pace, pace_of, put_pace

KEY = "0123456789abcdef0123"


class Recorder(LogProgress):
    """Remembers every report."""

    def __init__(self) -> None:
        self.told: list[tuple[str, int, int]] = []

    def advance(self, task: str, done: int, total: int) -> None:
        self.told.append((task, done, total))


def test_the_pace_of_a_cell_is_kept_as_it_goes_and_gone_when_it_ends(tmp_path: Path) -> None:
    store, recorder, now = Store(tmp_path), Recorder(), 100.0
    with KeptPace(recorder, store, KEY, lambda: now, name="a ball") as progress:
        progress.advance("stage 1", 41, 100)  # a checkpoint brought 40 of these
        first = pace_of(store, KEY)
        assert first is not None
        assert (first.task, first.done, first.total, first.steps_a_second) == ("stage 1", 41, 100, None)
        assert first.seconds_left is None
        now = 100.5
        progress.advance("stage 1", 46, 100)
        assert pace_of(store, KEY) == first  # not written more than once a second
        now = 105.0
        progress.advance("stage 1", 61, 100)
        later = pace_of(store, KEY)
        assert later is not None
        assert later.steps_a_second == pytest.approx(4.0)  # 20 steps in 5 s
        assert later.seconds_left == pytest.approx(39 / 4.0)
        progress.advance("evaluation", 1, 8)
        assert pace_of(store, KEY).task == "evaluation"  # type: ignore[union-attr]
    assert pace_of(store, KEY) is None
    steps = [("a ball: stage 1", done, 100) for done in (41, 46, 61)]
    assert recorder.told == [*steps, ("a ball: evaluation", 1, 8)]


def test_a_pace_file_that_cannot_be_written_stops_nothing(tmp_path: Path) -> None:
    (tmp_path / "locks").write_text("a file where the folder would be")
    store = Store(tmp_path)
    with KeptPace(LogProgress(), store, KEY) as progress:
        progress.advance("stage 1", 1, 10)
    assert pace_of(store, KEY) is None


@pytest.mark.parametrize(
    "content",
    [
        "", "[]", "{", '{"task": "a"}', "[" * 9000,
        '{"task": 3, "done": 1, "total": 2, "steps_a_second": 1.0, "written": 0.0}',
        '{"task": "\\u001b[2J", "done": 1, "total": 2, "steps_a_second": 1.0, "written": 0.0}',
        '{"task": "a", "done": 3, "total": 2, "steps_a_second": 1.0, "written": 0.0}',
        '{"task": "a", "done": 1, "total": 2, "steps_a_second": NaN, "written": 0.0}',
        '{"task": "a", "done": 1, "total": 2, "steps_a_second": 0.0, "written": 0.0}',
        '{"task": "a", "done": 1, "total": 2, "steps_a_second": 1.0, "written": Infinity}',
        '{"task": "a", "done": 1, "total": 2, "steps_a_second": 1.0, "written": "now"}',
        '{"task": "a", "done": 1, "total": 2, "steps_a_second": 1.0, "written": 0.0, "more": 1}',
    ],
)  # fmt: skip
def test_a_malformed_pace_file_is_ignored(content: str, tmp_path: Path) -> None:
    (tmp_path / "locks").mkdir()
    (tmp_path / "locks" / f"{KEY}.pace").write_text(content)
    assert pace_of(Store(tmp_path), KEY) is None


def test_the_parent_of_a_pool_shows_its_workers_tasks(tmp_path: Path) -> None:
    store, recorder = Store(tmp_path), Recorder()
    others = OthersProgress(recorder, store, {KEY: "corner ours seed 0"})
    others.look()
    put_pace(store, KEY, Pace("stage 1", 3, 10, None, time.time()))
    others.look()
    put_pace(store, KEY, Pace("stage 2", 1, 5, None, time.time()))
    others.look()
    drop_pace(store, KEY)
    others.look()
    others.look()
    assert recorder.told == [
        ("corner ours seed 0: stage 1", 3, 10),
        ("corner ours seed 0: stage 1", 10, 10),
        ("corner ours seed 0: stage 2", 1, 5),
        ("corner ours seed 0: stage 2", 5, 5),
    ]


@pytest.fixture
def half_done(tmp_path: Path) -> Iterator[tuple[Store, Sweep]]:
    """A folder in which the cells of seed 0 have finished (10 s per stage, 1 s of scoring); a cell of seed 1 runs."""
    request, sweep = asked(2), FakeSweep(tmp_path)
    places = [place for place, _ in request.cells]
    sweep.run([cell for place, cell in request.cells if place["seed"] == 0])
    for place in places[:5]:
        result = sweep.store.result(place["key"])
        assert result is not None
        seconds = {"initialise": 10.0, "invert": 20.0, "evaluate": 0.5, "relight": 0.5}
        arrays = {"render/image": np.zeros((1, 4, 3), np.float32)}
        sweep.store.put_result({**result, "seconds": seconds}, arrays)
    manifest = request.manifest()
    write_sweep(sweep.store, manifest)
    put_pace(sweep.store, places[5]["key"], Pace("stage 1", 30, 120, 6.0, time.time()))
    with sweep.store.claim(places[5]["key"]):
        yield sweep.store, manifest


def test_the_time_left_follows_finished_cells_and_counts_shared_stages_once(half_done: tuple[Store, Sweep]) -> None:
    store, sweep = half_done
    standing = standing_of(store, sweep)
    waiting = ["waits for stage 1 of another cell"] * 3  # all but nvs-init share it with the one that runs
    assert [cell.state for cell in standing.cells] == [*["finished"] * 5, "running", *waiting, "to do"]
    # Five cells with two different first stages.
    assert standing.seconds_left == pytest.approx(2 * 10 + 5 * 20 + 5 * 1)
    put_pace(store, sweep["cells"][6]["key"], Pace("stage 1", 1, 120, None, time.time()))
    with store.claim(sweep["cells"][6]["key"]):
        assert standing_of(store, sweep).seconds_left == pytest.approx(125 / 2)


KILLED = """
import os, sys, time
from pathlib import Path
from radiogs_bench.store.folder import Store
from radiogs_bench.store.pace import Pace, put_pace

store, key = Store(Path(sys.argv[1])), sys.argv[2]
with store.claim(key):
    put_pace(store, key, Pace("stage 1", 1, 3, None, time.time()))
    for name in (f"stages/.{sys.argv[3]}.checkpoint.pt.tmp", f"cells/.{key}.json.tmp"):
        (store.folder / name).parent.mkdir(exist_ok=True)
        (store.folder / name).write_text("half")
    os.kill(os.getpid(), 9)
"""
"""A process that is killed while it works on a cell and writes files."""


def test_killed_cells_are_not_running_and_the_next_run_cleans_up(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Attack status_after_kill: the state was running for ever, and --watch never ended."""
    request, sweep = asked(1), FakeSweep(tmp_path)
    places = [place for place, _ in request.cells]
    write_sweep(sweep.store, request.manifest())
    first = places[0]
    given = [str(tmp_path), first["key"], first["stages"][0]]
    assert subprocess.run([sys.executable, "-c", KILLED, *given], check=False).returncode == -9
    assert pace_of(sweep.store, first["key"]) is not None
    assert standing_of(sweep.store, read_sweep(tmp_path)).count("running") == 0
    assert main(["status", str(tmp_path), "--json", "--watch", "1"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["running"] == 0
    assert [cell["state"] for cell in told["cells"]] == ["to do"] * 5
    assert main(["status", str(tmp_path), "--watch", "1"]) == 0
    assert "nothing runs: what did was killed" in capsys.readouterr().out
    other = tmp_path / "stages" / ".living.pt.tmp"
    other.write_text("being written")
    with sweep.store.claim(stage_claim("living")):
        sweep.store.remove_leavings()
    assert [path.name for path in tmp_path.rglob("*.tmp")] == [other.name]
    assert pace_of(sweep.store, first["key"]) is None


def test_whether_a_claim_is_held_is_seen_without_writing(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert not store.is_claimed("x")
    with store.claim("x"):
        assert store.is_claimed("x")
    (tmp_path / "locks" / "x").write_text("of one that died")
    assert not store.is_claimed("x")
    assert (tmp_path / "locks" / "x").exists()


TERMINAL = """
import os, signal, sys, time
from radiogs_bench.errors import Interrupted
from radiogs_bench.runs.interruption import Interruption

with Interruption() as interruption:
    sys.stdout.write("ready"); sys.stdout.flush()
    while not interruption.requested:
        time.sleep(0.01)
    sys.stdout.write("a word that nobody reads"); sys.stdout.flush()
    open(sys.argv[1], "w").write("checkpoint")
"""


@pytest.mark.parametrize("ignored", [False, True])
def test_a_closed_terminal_asks_to_stop_as_ctrl_c_does_unless_that_is_ignored(ignored: bool, tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN if ignored else signal.SIG_DFL)  # inherited, as from nohup
    with subprocess.Popen(
        [sys.executable, "-c", TERMINAL, str(tmp_path / "kept")], stdout=theirs, stderr=theirs
    ) as process:
        signal.signal(signal.SIGHUP, before)
        os.close(theirs)
        assert os.read(ours, 100) == b"ready"
        os.close(ours)
        process.send_signal(signal.SIGHUP)
        try:
            process.wait(0.5 if ignored else 30)
        except subprocess.TimeoutExpired:
            process.kill()
    assert (tmp_path / "kept").exists() == (not ignored)


def test_a_silent_cell_is_marked_and_has_no_time_left(half_done: tuple[Store, Sweep]) -> None:
    store, sweep = half_done
    ago = time.time() - SILENT_AFTER_SECONDS - 5
    put_pace(store, sweep["cells"][5]["key"], Pace("stage 1", 30, 120, 6.0, ago))
    standing = standing_of(store, sweep)
    assert standing.cells[5].silent
    assert standing.seconds_left is None


def test_status_prints_step_speed_and_time_left(
    half_done: tuple[Store, Sweep], capsys: pytest.CaptureFixture[str]
) -> None:
    store, sweep = half_done
    assert main(["status", str(store.folder)]) == 0
    shown = capsys.readouterr().out
    (line,) = [line for line in shown.splitlines() if label(sweep["cells"][5]) in line]
    assert [part.strip() for part in line.split("|")[3:7]] == ["stage 1", "30/120", "6", "15 s"]
    assert "5 of 10 cells finished" in shown
    assert "about 2 min left" in shown


def test_on_80_columns_keys_give_way_and_no_number_is_cut(
    half_done: tuple[Store, Sweep], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    store, sweep = half_done
    put_pace(store, sweep["cells"][5]["key"], Pace("stage 1", 123_456, 200_000, 1234.5, time.time()))
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    assert main(["status", str(store.folder)]) == 0
    shown = re.sub(r"\x1b\[[\d;]*m", "", capsys.readouterr().out)
    assert max(map(len, shown.splitlines())) <= 80
    assert sweep["cells"][5]["key"] not in shown
    assert "123456/200000" in shown
    assert "1.23e+03" in shown
    assert "…" not in shown


def test_status_is_read_by_programs(half_done: tuple[Store, Sweep], capsys: pytest.CaptureFixture[str]) -> None:
    store, sweep = half_done
    assert main(["status", str(store.folder), "--json"]) == 0
    told: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert (told["finished"], told["running"], told["total"]) == (5, 1, 10)
    assert told["seconds_left"] == pytest.approx(125)
    running = told["cells"][5]
    assert running["cell"] == label(sweep["cells"][5])
    assert (running["task"], running["done"], running["total"], running["seconds_left_of_task"]) == (
        "stage 1", 30, 120, 15.0,
    )  # fmt: skip
    assert "task" not in told["cells"][0]


def test_watching_ends_when_no_cell_is_left(
    fake_run: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    looks = 0
    request = asked(1)
    sweep, cells = FakeSweep(tmp_path), [cell for _, cell in request.cells]
    write_sweep(sweep.store, request.manifest())

    def meanwhile(seconds: float) -> None:
        nonlocal looks
        assert seconds == 7
        sweep.run([cells[looks]])
        looks += 1

    monkeypatch.setattr(time, "sleep", meanwhile)
    assert main(["status", str(tmp_path), "--json", "--watch", "7"]) == 0
    told = [json.loads(line)["finished"] for line in capsys.readouterr().out.splitlines()]
    assert told == [0, 1, 2, 3, 4, 5]
    assert main(["status", str(tmp_path), "--watch"]) == 0
    assert capsys.readouterr().out.count("5 of 5 cells finished") == 1


def test_a_run_keeps_the_pace_of_its_cells(
    fake_run: Callable[..., int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Pace | None] = []

    def look(bench: Any, cell: Any, *rest: Any) -> Any:
        seen.append(pace_of(bench.store, cell.key))
        return evaluated(bench, cell, *rest)

    evaluated = fake_method.evaluate
    monkeypatch.setitem(fake_method.__dict__, "evaluate", look)
    assert fake_run("ablations") == 0
    assert len(seen) == 10
    assert all(pace is not None and pace.task == "fake invert" and pace.total == fake_method.STEPS for pace in seen)
    assert not list((tmp_path / "locks").glob("*.pace"))


def test_the_time_left_is_unknown_before_a_similar_cell_has_finished(tmp_path: Path) -> None:
    request = asked(1)
    sweep = FakeSweep(tmp_path)
    manifest = request.manifest()
    put_pace(sweep.store, fake_cell().key, Pace("stage 1", 1, 3, None, time.time()))
    with sweep.store.claim(fake_cell().key):
        standing = standing_of(sweep.store, manifest)
    assert standing.count("running") == 1
    assert standing.seconds_left is None
