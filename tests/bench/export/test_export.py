"""The exported table holds what the store holds, line for line."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import radiogs_bench as rb
from bench.fake_method import FakeSweep, asked, write_sweep
from radiogs_bench.cli import main
from radiogs_bench.runs.sweep import read_sweep

REQUEST = asked(2)


@pytest.fixture
def store(tmp_path: Path) -> FakeSweep:
    sweep = FakeSweep(tmp_path)
    cells = REQUEST.cells
    write_sweep(sweep.store, REQUEST.manifest())
    sweep.run([cell for _, cell in cells])
    return sweep


@pytest.mark.parametrize("form", ["csv", "json"])
def test_every_metric_of_every_cell_is_a_line(store: FakeSweep, form: str) -> None:
    folder = store.store.folder
    with np.printoptions(legacy="1.13"):  # as some libraries set it: 12 digits
        assert main(["export", str(folder), "--to", form]) == 0
    file = folder / f"export.{form}"
    table = pd.read_csv(file) if form == "csv" else pd.DataFrame(json.loads(file.read_text()))
    stored = {result["key"]: result for result in store.store.results()}
    rows_of_cells = {ref["key"]: ref["row"] for ref in read_sweep(folder)["cells"]}
    assert table.columns[0] == "row"
    assert len(stored) == 10
    assert len(table) == sum(len(result["metrics"]) for result in stored.values())
    for line in table.to_dict("records"):
        result = stored[line["key"]]
        value = result["metrics"][line["metric"]]["value"]
        if value is None:
            assert pd.isna(line["value"]), line
        else:
            assert line["value"] == value, line["metric"]
        assert line["row"] == rows_of_cells[line["key"]]
        assert line["seed"] == result["cell"]["seed"]
        assert line["variant.detach"] == result["cell"]["variant"]["detach"]
        assert (
            line["guards.faint_surfels"] == sum(each["faint_surfels"] for each in result["guards"].values() if each) > 0
        )
        assert line["work.steps"] == sum(counters.get("steps", 0) for counters in result["work"].values())


def test_a_frame_has_the_settings_in_one_column_or_each_in_its_own_and_the_values_of_views(store: FakeSweep) -> None:
    folder = store.store.folder
    frame, wide, views = (
        rb.open_store(folder),
        rb.open_store(folder, settings=True),
        rb.open_store(folder, by_view=True),
    )
    assert list(frame.columns[:4]) == ["row", "scene", "method", "settings"]
    fields = [name for name in wide if name.startswith("variant.")]
    assert [{f"variant.{name}": value for name, value in json.loads(each).items()} for each in frame["settings"]] == (
        wide[fields].to_dict("records")
    )
    assert frame["value"].equals(wide["value"])
    for result in store.store.results():
        own = views[(views["key"] == result["key"]) & (views["metric"] == "nvs/psnr")]
        assert dict(zip(own["view"], own["value"], strict=True)) == dict(
            zip(result["views"], result["metrics"]["nvs/psnr"]["views"], strict=True)
        )


def test_parquet_without_its_library_says_what_to_install(store: FakeSweep, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        assert main(["export", str(store.store.folder), "--to", "parquet"]) == 2
        assert "pip install 'radiogs-bench[parquet]'" in capsys.readouterr().err
    else:
        assert main(["export", str(store.store.folder), "--to", "parquet"]) == 0
        assert len(pd.read_parquet(store.store.folder / "export.parquet")) == 10


def test_event_files_hold_the_trail_of_every_cell(store: FakeSweep, capsys: pytest.CaptureFixture[str]) -> None:
    folder = store.store.folder
    arguments = ["export", str(folder), "--to", "tensorboard"]
    try:
        from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
    except ImportError:
        assert main(arguments) == 2
        assert "pip install 'radiogs-bench[tensorboard]'" in capsys.readouterr().err
        return
    assert main(arguments) == 0
    assert len(list((folder / "tensorboard").rglob("events.*"))) == 10
    place = REQUEST.manifest()["cells"][0]
    result = store.store.result(place["key"])
    read = EventAccumulator(
        str(folder / "tensorboard" / place["row"] / f"{place['scene']}-seed-{place['seed']}")
    ).Reload()
    for stage, points in result["trail"].items():
        for name in points[-1]["losses"]:
            found = [(event.step, event.value) for event in read.Scalars(f"{stage}/loss/{name}")]
            assert found == [(point["iteration"], pytest.approx(point["losses"][name])) for point in points]
    (end,) = read.Scalars("end/nvs/psnr")
    assert end.value == pytest.approx(result["metrics"]["nvs/psnr"]["value"])


def test_a_folder_without_a_run_is_an_error(tmp_path: Path) -> None:
    assert main(["export", str(tmp_path)]) == 3
