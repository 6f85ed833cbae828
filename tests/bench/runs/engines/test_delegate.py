"""A cell that another process runs gives the files that it would have given here, or says why not."""

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bench import fake_method
from bench.fake_method import CPU, SCENE, FakeSweep, asked
from bench.kill_everywhere import table
from radiogs_bench.errors import Interrupted
from radiogs_bench.runs.cell import Cell
from radiogs_bench.runs.engines.delegate import (
    Recipe,
    RemoteCell,
    RemoteResult,
    names_of,
    run_remote_cell,
    run_shared_stages,
    scene_for,
)
from radiogs_bench.runs.interruption import Interruption
from radiogs_bench.runs.stages import all_but_last
from radiogs_bench.store.folder import Store
from radiogs_core.errors import DataError, NumericalFailure, UsageError
from radiogs_datasets import load_scene
from radiogs_datasets.options import AS_STORED, SceneOptions

RECIPE = Recipe(fake_method.method, fake_method.experiment, fake_method.load, "nowhere/fake")
CELLS = [cell for _, cell in asked().cells]


def remote(cell: Cell = CELLS[0], **changes: Any) -> RemoteCell:
    return replace(RemoteCell(RECIPE, cell, "nowhere/fake", 1), **changes)


def test_delivered_cells_are_what_a_run_here_would_have_made(tmp_path: Path) -> None:
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
