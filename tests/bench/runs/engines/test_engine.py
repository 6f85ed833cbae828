"""Cells run in this process: shared, resumed, delegated, and failing alone."""

import os
import pickle
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from bench import fake_method
from bench.fake_method import CPU, SCENE, FakeSweep, asked, fake_cell
from bench.kill_everywhere import table
from radiogs_bench.errors import Interrupted, StoreError
from radiogs_bench.runs.cell import Cell
from radiogs_bench.runs.engines import in_process as engine
from radiogs_bench.runs.engines.delegate import (
    Recipe,
    RemoteCell,
    RemoteResult,
    names_of,
    run_remote_cell,
    run_shared_stages,
    scene_for,
)
from radiogs_bench.runs.engines.in_process import Task, run_cells
from radiogs_bench.runs.interruption import Interruption
from radiogs_bench.runs.progress import LogProgress
from radiogs_bench.runs.scene_checksum import checksum_now
from radiogs_bench.runs.stages import Bench, all_but_last
from radiogs_bench.store.claim import Claimed
from radiogs_bench.store.folder import Store, product_name
from radiogs_core.errors import DataError, ExplainedError, NumericalFailure, UsageError
from radiogs_datasets import load_scene
from radiogs_datasets.options import AS_STORED, SceneOptions

ROWS = [cell for _, cell in asked().cells]


@pytest.fixture
def sweep(tmp_path: Path) -> FakeSweep:
    fake_method.begun.clear()
    return FakeSweep(tmp_path)


def test_four_of_the_five_ablations_share_one_initialisation(sweep: FakeSweep) -> None:
    assert sweep.run(ROWS) == []
    assert sorted(name for name in fake_method.begun if "initialise" in name) == [
        "initialise nvs 0",
        "initialise radiometric 0",
    ]
    assert sum("invert" in name for name in fake_method.begun) == 5


def test_a_second_call_begins_nothing(sweep: FakeSweep) -> None:
    sweep.run(ROWS)
    before = [sweep.store.result(cell.key) for cell in ROWS]
    fake_method.begun.clear()
    sweep.run(ROWS)
    assert fake_method.begun == []
    assert [sweep.store.result(cell.key) for cell in ROWS] == before


def test_shared_seconds_and_work_are_counted_in_every_cell(sweep: FakeSweep) -> None:
    sweep.run(ROWS)
    results = [sweep.store.result(cell.key) for cell in ROWS[:4]]
    assert len({each["seconds"]["initialise"] for each in results if each}) == 1
    for each in results:
        assert each["work"] == {
            "initialise": {"begun": 1, "steps": 6},
            "invert": {"begun": 1, "steps": 6},
            "evaluate": {"evaluated": 1},
        }


def test_scoring_under_another_protocol_trains_nothing(sweep: FakeSweep) -> None:
    sweep.run([fake_cell()])
    fake_method.begun.clear()
    sweep.run([fake_cell(protocol="irgs")])
    assert fake_method.begun == []
    assert sweep.store.result(fake_cell(protocol="irgs").key) is not None


def test_stopping_after_any_step_gives_the_same_result(sweep: FakeSweep, tmp_path: Path) -> None:
    sweep.run([fake_cell()])
    whole = sweep.store.result(fake_cell().key)
    stopped = FakeSweep(tmp_path / "stopped")
    stops = 0  # three in each stage: after two of its steps and after storing it
    while stopped.store.result(fake_cell().key) is None:
        interruption = Interruption()
        interruption.requested = stops < 6
        bench = Bench(stopped.store, CPU, LogProgress(), interruption, fake_method.method, checksum_now)
        try:
            fake_method.experiment(bench, fake_cell(), SCENE)
        except Interrupted:
            stops += 1
    assert stops == 6
    resumed = stopped.store.result(fake_cell().key)
    assert resumed["metrics"] == whole["metrics"]
    assert resumed["work"] == whole["work"]
    assert resumed["parts"] == whole["parts"]
    assert resumed["parts"]["invert"] == {"probe": 1 + 2 + 3}
    assert resumed["first_steps"] == whole["first_steps"]
    assert [len(steps) for steps in whole["first_steps"].values()] == [3, 3]
    assert len(resumed["sessions"]["initialise"]) == 3
    assert not list(tmp_path.rglob("*.checkpoint.pt"))


def test_a_cell_that_fails_leaves_the_others_alone(sweep: FakeSweep, monkeypatch: pytest.MonkeyPatch) -> None:
    bad = fake_cell(seed=1)

    def one(cell: Cell) -> None:
        if cell == bad:
            raise NumericalFailure("loss is NaN", "it spreads", "look")
        sweep.one(cell)

    tasks = [Task(cell, cell.key) for cell in (fake_cell(), bad, fake_cell(seed=2))]
    failures = run_cells(tasks, one, sweep.store, LogProgress(), sweep.interruption)
    assert [failure.what for failure in failures] == ["loss is NaN"]
    assert len(list(sweep.store.results())) == 2
    failure = sweep.store.failure(bad.key)
    assert failure["exit_code"] == 4
    assert sweep.run([bad]) == []  # tried again, and now it works
    assert sweep.store.failure(bad.key) is None


@pytest.mark.parametrize("kind", [DataError, StoreError, Interrupted])
def test_a_failure_that_all_cells_would_share_ends_the_sweep(kind: type[ExplainedError], sweep: FakeSweep) -> None:
    tried: list[Cell] = []

    def one(cell: Cell) -> None:
        tried.append(cell)
        raise kind("it broke")

    with pytest.raises(kind):
        run_cells([Task(cell, cell.key) for cell in ROWS], one, sweep.store, LogProgress(), sweep.interruption)
    assert len(tried) == 1


def test_a_cell_of_another_process_is_waited_for(
    sweep: FakeSweep, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    theirs = ROWS[0]
    claim = sweep.store.claim(theirs.key)
    claim.__enter__()
    waits: list[float] = []

    def wait(seconds: float) -> None:
        waits.append(seconds)
        if len(waits) == 3:  # the other process finishes
            claim.__exit__(None, None, None)
            sweep.one(theirs)

    monkeypatch.setattr(engine.time, "sleep", wait)
    assert sweep.run(ROWS) == []
    assert len(waits) == 3
    assert len(list(sweep.store.results())) == 5
    assert capsys.readouterr().err.count(": started") == 4  # theirs was never started here


@pytest.mark.slow
def test_two_processes_on_one_store_share_the_cells(sweep: FakeSweep, tmp_path: Path) -> None:
    """Both end, every cell is there, and no stage was begun twice."""
    program = (
        "import sys\n"
        "from pathlib import Path\n"
        "from bench import fake_method\n"
        "rows = [cell for _, cell in fake_method.asked().cells]\n"
        "assert fake_method.FakeSweep(Path(sys.argv[1])).run(rows) == []\n"
        "print(len(fake_method.begun))\n"
    )
    command, tests = [sys.executable, "-c", program, str(tmp_path)], Path(__file__).parents[3]
    both = [subprocess.Popen(command, cwd=tests, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    counts = [int(each.communicate()[0]) for each in both]
    assert [each.returncode for each in both] == [0, 0]
    assert sum(counts) == 2 + 5
    assert len(list(sweep.store.results())) == 5


def test_a_damaged_checkpoint_restarts_its_stage_alone(sweep: FakeSweep, tmp_path: Path) -> None:
    interruption = Interruption()
    interruption.requested = True
    with pytest.raises(Interrupted):
        fake_method.experiment(replace(sweep.bench, interruption=interruption), fake_cell(), SCENE)
    (checkpoint,) = tmp_path.rglob("*.checkpoint.pt")
    checkpoint.write_bytes(b"garbage")
    assert sweep.run([fake_cell()]) == []


def test_ctrl_c_becomes_a_request_and_the_second_acts_at_once() -> None:
    before = signal.getsignal(signal.SIGINT)  # a shell in the background has its children ignore it
    with Interruption() as interruption:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0)
        assert interruption.requested
        with pytest.raises(Interrupted, match="Run the same command again"):
            interruption.check()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) != before
    assert signal.getsignal(signal.SIGINT) is before


def test_checkpoints_are_rarer_where_they_are_slow(sweep: FakeSweep, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a share of 1e-9 the first checkpoint of a stage must also be its last."""
    written: list[str] = []
    put = sweep.store.put_tensors

    def recording(name: str, content: dict[str, object]) -> None:
        written.append(name)
        put(name, content)

    monkeypatch.setattr(sweep.store, "put_tensors", recording)
    fake_method.experiment(replace(sweep.bench, checkpoint_share=1e-9), fake_cell(), SCENE)
    assert sum("checkpoint" in name for name in written) == 2


def test_claimed_names_the_holder(sweep: FakeSweep) -> None:
    with sweep.store.claim("x"), pytest.raises(Claimed) as caught, sweep.store.claim("x"):
        pass
    assert f"process {os.getpid()}" in str(caught.value)


def test_the_model_survives_the_store(sweep: FakeSweep) -> None:
    sweep.run([fake_cell()])
    stored = sweep.store.tensors(product_name(fake_cell().stages[-1].key), CPU)
    assert torch.equal(stored["product"]["surfels"]["sh"], torch.zeros(4, 16, 3))


RECIPE = Recipe(fake_method.method, fake_method.experiment, fake_method.load, "nowhere/fake")
CELLS = [cell for _, cell in asked().cells]


def remote(cell: Cell = CELLS[0], **changes: Any) -> RemoteCell:
    return replace(RemoteCell(RECIPE, cell, "nowhere/fake", 1), **changes)


def test_delivered_cells_equal_cells_of_a_local_run(tmp_path: Path) -> None:
    here, there = FakeSweep(tmp_path / "here"), Store(tmp_path / "there")
    here.run(CELLS)
    firsts: dict[str, RemoteResult] = {}
    for cell in CELLS:
        travelled = pickle.loads(pickle.dumps(remote(cell)))
        key = cell.first_key
        firsts[key] = firsts.get(key) or run_shared_stages(travelled, {})
        outcome = pickle.loads(pickle.dumps(run_remote_cell(travelled, {}, firsts[key])))
        assert outcome.failure is None
        there.take_over({**firsts[key].files, **outcome.files})
    assert len(firsts) == 2
    assert table(there.folder) == table(here.store.folder)

    def names(folder: Path) -> list[Path]:
        return sorted(path.relative_to(folder) for path in folder.rglob("*.*"))

    assert names(there.folder) == names(here.store.folder)


def test_a_stage_that_was_begun_here_is_continued_there(tmp_path: Path) -> None:
    sweep = FakeSweep(tmp_path)
    begun, cell = Interruption(), CELLS[0]
    begun.requested = True
    with pytest.raises(Interrupted):
        all_but_last(replace(sweep.bench, interruption=begun), cell, SCENE)
    product, checkpoint = names_of(cell.stages[0])
    given = sweep.store.files([f"{product}.pt", f"{checkpoint}.pt"])
    assert list(given) == [f"{checkpoint}.pt"]
    sweep.store.take_over(run_shared_stages(remote(cell), given).files)
    outcome = sweep.store.tensors(product, CPU)
    assert len(outcome["ledger"]["sessions"]) == 2
    assert outcome["ledger"]["work"] == {"begun": 1, "steps": 6}


def test_other_sources_are_refused() -> None:
    outcome = run_shared_stages(remote(replace(CELLS[0], method_code="other")), {})
    assert outcome.files == {}
    assert isinstance(outcome.failure, UsageError)
    assert "other sources" in outcome.failure.what


def test_another_scene_under_the_same_path_is_refused() -> None:
    outcome = run_shared_stages(remote(replace(CELLS[0], checksum="1" * 64)), {})
    assert isinstance(outcome.failure, DataError)
    assert "nowhere/fake" in outcome.failure.what


def test_a_remote_failure_keeps_its_three_parts_and_fails_the_cells_that_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    def bad(*arguments: Any) -> Any:
        raise NumericalFailure("the loss is NaN", "it spreads", "look")

    first = run_shared_stages(remote(), {})
    outcome = run_remote_cell(remote(recipe=replace(RECIPE, experiment=bad)), {}, first)
    back = pickle.loads(pickle.dumps(outcome)).failure
    assert isinstance(back, NumericalFailure)
    assert (back.what, back.why, back.remedy) == ("the loss is NaN", "it spreads", "look")
    assert run_remote_cell(remote(), {}, outcome) is outcome


def test_a_scene_is_opened_on_another_machine_as_it_was_here() -> None:
    recipe = replace(RECIPE, load=load_scene, options=SceneOptions(long_side=41))
    assert (
        scene_for(pickle.loads(pickle.dumps(recipe)), "convex").checksum
        == load_scene("convex", options=SceneOptions(long_side=41)).checksum
    )
    assert scene_for(replace(recipe, options=AS_STORED), "convex").checksum == load_scene("convex").checksum
