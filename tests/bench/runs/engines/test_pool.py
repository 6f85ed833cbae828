"""Workers of a pool, and the order in which they take cells."""

import heapq
import json
import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from bench.fake_method import FakeSweep, asked, fake_cell, scene_of
from radiogs_bench.child_process import CHILD
from radiogs_bench.runs.cell import Cell
from radiogs_bench.runs.engines import run as engines
from radiogs_bench.runs.engines.choice import Engine
from radiogs_bench.runs.engines.in_process import waits_for_others
from radiogs_bench.runs.engines.run import Order, in_turn, run_by_pool, run_pool
from radiogs_bench.runs.interruption import Interruption
from radiogs_bench.runs.spec import RunSpec
from radiogs_bench.store.folder import Store, product_name, stage_claim
from radiogs_core.kernels.runtime import use_threads

WAIT = """
import signal, sys, time
signal.signal(signal.SIGTERM, lambda *_: (print("asked", file=sys.stderr), sys.exit(130)))
print("ready", file=sys.stderr, flush=True)
time.sleep(60)
"""


NOTHING = Order({}, "", (), 1)
"""For processes that read no order."""


def python(code: str) -> list[str]:
    return [sys.executable, "-c", code]


def test_lines_of_workers_are_printed_and_their_exit_codes_returned() -> None:
    said: list[str] = []
    commands = [python("import sys; print('one', file=sys.stderr); sys.exit(3)"), python("print('not this')")]
    assert run_pool(commands, NOTHING, said.append, lambda: None, Interruption()) == [3, 0]
    assert said == ["one"]


def test_the_pool_asks_each_worker_to_stop_once_and_waits_for_it() -> None:
    said: list[str] = []
    interruption = Interruption()

    def say(line: str) -> None:
        said.append(line)
        if said.count("ready") == 2:
            interruption.requested = True

    assert run_pool([python(WAIT)] * 2, NOTHING, say, lambda: None, interruption) == [130, 130]
    assert said.count("asked") == 2


def test_the_exit_code_of_a_killed_worker_is_its_signal() -> None:
    code = "import os, signal; os.kill(os.getpid(), signal.SIGKILL)"
    assert run_pool([python(code)], NOTHING, lambda line: None, lambda: None, Interruption()) == [-signal.SIGKILL]


def test_workers_are_given_the_spec_with_their_share_of_the_threads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[tuple[list[tuple[str, ...]], Order]] = []

    def pool(commands: list[tuple[str, ...]], order: Order, *rest: object) -> list[int]:
        given.append((commands, order))
        return [0] * len(commands)

    monkeypatch.setattr(engines, "run_pool", pool)
    use_threads(5)
    plan = asked(2, keep_views=3)
    run_by_pool(plan, FakeSweep(tmp_path).bench, Engine("pool", workers=2))
    ((commands, order),) = given
    assert commands == [(*CHILD, "work")] * 2
    assert RunSpec.from_plain(order.spec) == replace(plan.spec, threads=2)
    assert (order.out, order.trusted, order.count) == (str(tmp_path), (), 2)


DECOYS = ("queue", "json", "numpy", "torch", "signal", "radiogs_bench", "radiogs_core", "radiogs", "conftest")
"""Names of the standard library's modules, of other packages and of ours."""


@pytest.mark.slow
def test_no_process_of_the_harness_runs_code_of_the_folder_where_it_is_started(tmp_path: Path) -> None:
    for name in DECOYS:
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(
            "from pathlib import Path\nPath(__file__).with_name('ran').touch()\n"
        )
        (tmp_path / f"{name}.py").write_text("from pathlib import Path\nPath(__file__).with_name('ran').touch()\n")
    elsewhere = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    done = subprocess.run(
        [*CHILD[:3], "radiogs_bench", "methods", "--json"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env=elsewhere,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert not list(tmp_path.rglob("ran"))


def run(folder: Path, *more: str) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "radiogs_bench", "run", "ablations", "--scenes", "corner", "--preset", "smoke"]
    return subprocess.Popen(
        [*command, "--rows", "ours,no-rad", "--seeds", "2", "--long-side", "32", "--out", str(folder), *more],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        text=True,
    )


def results(folder: Path) -> dict[str, tuple[object, object]]:
    stored = (json.loads(path.read_text()) for path in (folder / "cells").glob("*.json"))
    return {each["key"]: (each["metrics"], each["work"]) for each in stored}


def worker_processes(parent: int) -> list[int]:
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            try:
                fields = (entry / "stat").read_text().rsplit(")", 1)[1].split()
            except OSError:
                continue
            if int(fields[1]) == parent and fields[0] != "Z":
                found.append(int(entry.name))
    return found


@pytest.mark.slow
def test_a_killed_worker_costs_no_result(tmp_path: Path) -> None:
    alone = run(tmp_path / "alone", "--threads", "1")
    assert alone.wait() == 0
    pool = run(tmp_path / "pool", "--threads", "2", "--workers", "2")
    while len(results(tmp_path / "pool")) < 2:
        assert pool.poll() is None
        time.sleep(0.1)
    os.kill(worker_processes(pool.pid)[0], signal.SIGKILL)
    assert pool.wait() == 0
    assert results(tmp_path / "pool") == results(tmp_path / "alone")


STAGE_1, REST = 54.0, 36.0
"""Seconds of stage 1, and of stage 2 with the evaluation, of a cell of ``make ablations``."""


def cells_of(scenes: int) -> list[Cell]:
    """The ablations on so many scenes."""
    whole = asked(scenes={name: scene_of(name) for name in map(str, range(scenes))})
    return [cell for _, cell in in_turn(whole.cells, Store(Path("nowhere")), 2)]


def seconds_of(order: list[Cell], seed: int) -> tuple[float, float]:
    """When the last of two workers ends, which take the next cell that can be run, and half of all their seconds.

    Scenes differ by a fifth, cells by a twentieth.
    """
    drawn = random.Random(seed)
    factor = {scene: drawn.uniform(0.8, 1.2) for scene in sorted({cell.scene for cell in order})}
    length = {cell.key: REST * factor[cell.scene] * drawn.uniform(0.95, 1.05) for cell in order}
    ready: dict[str, float] = {}
    free, left, end, work = [0.0, 0.0], list(order), 0.0, 0.0
    while left:
        now = heapq.heappop(free)
        found = next((cell for cell in left if ready.get(cell.first_key, 0.0) <= now), None)
        if found is None:
            heapq.heappush(free, min(when for when in ready.values() if when > now))
            continue
        left.remove(found)
        taken = length[found.key]
        if found.first_key not in ready:
            taken += STAGE_1 * factor[found.scene]
            ready[found.first_key] = now + STAGE_1 * factor[found.scene]
        work += taken
        end = max(end, now + taken)
        heapq.heappush(free, now + taken)
    return end, work / 2


def test_two_workers_end_the_ablations_within_2_percent_of_the_optimum() -> None:
    order = cells_of(8)
    for seed in range(20):
        end, least = seconds_of(order, seed)
        assert least <= end < 1.02 * least


def test_scenes_are_complete_one_after_another_but_for_the_last_two() -> None:
    scenes = [cell.scene for cell in cells_of(5)]
    assert scenes[:15] == [scene for scene in "012" for _ in range(5)]
    assert sorted(scenes[15:]) == ["3"] * 5 + ["4"] * 5


def test_cells_that_train_a_stage_for_others_come_first_at_the_end() -> None:
    last = cells_of(2)
    firsts = [cell.first_key for cell in last]
    assert len(set(firsts[:4])) == 4
    assert [cell.scene for cell in last[4:]] == ["0"] * 3 + ["1"] * 3


@pytest.mark.parametrize("place", [0, 1])
def test_a_cell_waits_for_the_process_that_trains_its_next_stage(tmp_path: Path, place: int) -> None:
    store, cell = Store(tmp_path), fake_cell()
    for stage in cell.stages[:place]:
        store.put_tensors(product_name(stage.key), {})
    assert not waits_for_others(store, cell)
    with store.claim(stage_claim(cell.stages[1 - place].key)):
        assert not waits_for_others(store, cell)
    with store.claim(stage_claim(cell.stages[place].key)):
        assert waits_for_others(store, cell)
    assert not waits_for_others(store, cell)


def test_a_cell_that_waits_is_not_announced_and_is_taken_up_as_soon_as_it_can_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Another process trains what the first two cells share, and has done so when the third has been run."""
    sweep = FakeSweep(tmp_path)
    blocked, later = (fake_cell(seed=0), fake_cell(seed=0, protocol="irgs")), fake_cell(seed=1)
    last = fake_cell(seed=2)
    claim = sweep.store.claim(stage_claim(blocked[0].first_key))
    claim.__enter__()
    one, order = sweep.one, []

    def run(cell: Cell) -> None:
        order.append(cell)
        one(cell)
        if cell is later:
            claim.__exit__(None, None, None)

    sweep.one = run  # type: ignore[method-assign]
    assert sweep.run([*blocked, later, last]) == []
    assert order == [later, *blocked, last]
    assert capsys.readouterr().err.count(": started") == 4
