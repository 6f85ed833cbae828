"""The manifest suffices to rebuild a table, and gives the state of each cell."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bench.fake_method import SCENE, FakeSweep, asked, fake_cell, place_of, write_sweep
from radiogs.settings import PRESETS
from radiogs_bench.results.summary import summarise
from radiogs_bench.runs.plan import RunPlan, planned
from radiogs_bench.runs.spec import RunSpec
from radiogs_bench.runs.sweep import read_sweep, state_of, steps_to_take
from radiogs_bench.store.folder import Store, product_name
from radiogs_bench.store.seal import sealed
from radiogs_bench.suites.paper import ABLATIONS
from radiogs_core.errors import DataError
from radiogs_datasets import load_scene


def request() -> RunPlan:
    return asked(2)


def test_cells_are_every_row_of_every_scene_and_seed() -> None:
    places = [place for place, _ in request().cells]
    assert len(places) == 10
    assert len({place["key"] for place in places}) == 10
    assert len({place["stages"][0] for place in places}) == 4  # two kinds, two seeds
    assert [place["row"] for place in places[:5]] == [row.key for row in ABLATIONS.rows]


def test_the_manifest_comes_back_as_written(tmp_path: Path) -> None:
    manifest = request().manifest()
    write_sweep(Store(tmp_path), manifest)
    assert read_sweep(tmp_path) == sealed(manifest)


def test_the_manifest_holds_the_kinds_that_scenes_state() -> None:
    stated = {name: load_scene(name) for name in ("corner", "bowl", "front_plain")}
    manifest = replace(request(), scenes={**stated, "fake": SCENE}).manifest()
    kinds, other = manifest["kinds"], manifest["stated"]
    assert other == {name: {"choices": "tuned on"} for name in stated} | {"fake": {}}
    assert kinds["corner"] == kinds["bowl"]
    assert len({kinds["corner"], kinds["front_plain"], kinds["fake"]}) == 3
    assert "kinds" not in request().manifest()


def test_the_command_line_is_kept_in_the_summary(tmp_path: Path) -> None:
    typed = ["run", "ablations", "--scenes", "a b", "--long-side", "48"]
    write_sweep(Store(tmp_path), request().manifest(typed))
    assert summarise(Store(tmp_path), read_sweep(tmp_path), {}, "")["command"] == typed
    assert "command" not in summarise(Store(tmp_path), request().manifest(), {}, "")


@pytest.mark.parametrize("content", ["{", '{"schema": "other/1"}'])
def test_a_manifest_that_cannot_be_read_is_explained(content: str, tmp_path: Path) -> None:
    (tmp_path / "sweep.json").write_text(content)
    with pytest.raises(DataError, match="Run the same command again"):
        read_sweep(tmp_path)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"reference": "our"}, "its reference row 'our' is none of its rows"),
        ({"rows": []}, "its reference row 'ours' is none of its rows"),
        ({"rows": [], "reference": None}, "a cell is of row 'ours', which it lacks"),
        ({"scenes": ["fakes"]}, "a cell is of scene 'fake', which it lacks"),
        ({"columns": ["nvs/psnr", "nvs"]}, "its column 'nvs' is no metric"),
    ],
)
def test_a_manifest_that_contradicts_itself_is_explained(changes: dict[str, Any], says: str, tmp_path: Path) -> None:
    manifest = request().manifest()
    write_sweep(Store(tmp_path), {**manifest, **changes})  # type: ignore[typeddict-item]
    with pytest.raises(DataError, match=says):
        read_sweep(tmp_path)


def test_a_folder_without_a_run_is_explained(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no run in"):
        read_sweep(tmp_path / "nowhere")


def test_the_state_of_a_cell_follows_from_its_stored_files(tmp_path: Path) -> None:
    sweep, cell = FakeSweep(tmp_path), fake_cell()
    place = place_of(cell)
    first, second = (product_name(stage.key) for stage in cell.stages)
    kept = {
        f"{first}.checkpoint": "begun: in stage 1",
        first: "to do: stage 1 is there",
        f"{second}.checkpoint": "begun: in stage 2",
        second: "trained, not scored",
    }
    assert state_of(sweep.store, place) == "to do"
    for name, state in kept.items():
        sweep.store.put_tensors(name, {})
        assert state_of(sweep.store, place) == state
    for name in kept:
        sweep.store.drop_tensors(name)
    sweep.run([cell])
    assert state_of(sweep.store, place) == "finished"
    assert json.loads((tmp_path / "cells" / f"{cell.key}.json").read_text())["scene"] == "fake"


def test_steps_to_take_count_shared_stages_once_and_stored_ones_not_at_all(tmp_path: Path) -> None:
    of_radiogs = planned(ABLATIONS, {"fake": SCENE}, RunSpec("ablations", seeds=2, preset="smoke", protocol="default"))
    store, cells = Store(tmp_path), [cell for _, cell in of_radiogs.cells]
    cost = PRESETS["smoke"]
    whole = 4 * cost.geometry.steps + 10 * cost.inverse_iterations
    assert steps_to_take(store, cells) == whole
    for stage in cells[0].stages:
        store.put_tensors(product_name(stage.key), {})
    assert steps_to_take(store, cells) == whole - cost.geometry.steps - cost.inverse_iterations
    assert steps_to_take(store, []) == 0


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2, 3, 50])
def test_shards_are_every_cell_once_and_share_no_first_stage(count: int) -> None:
    whole = asked(4)
    shards = [[cell for _, cell in asked(4, shard=(number, count)).own_cells] for number in range(count)]
    assert sorted(cell.key for shard in shards for cell in shard) == sorted(cell.key for _, cell in whole.cells)
    firsts = [{cell.first_key for cell in shard} for shard in shards]
    assert sum(map(len, firsts)) == len(set().union(*firsts))
