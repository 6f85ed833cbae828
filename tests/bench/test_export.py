"""The exported table holds what the store holds, line for line."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.fake_method import FakeSweep, asked, write_sweep
from radiogs_bench.cli import main

REQUEST = asked(2)


@pytest.fixture
def store(tmp_path: Path) -> FakeSweep:
    sweep = FakeSweep(tmp_path)
    cells = REQUEST.cells()
    write_sweep(sweep.store, REQUEST.manifest([place for place, _ in cells]))
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
    assert len(stored) == 10
    assert len(table) == sum(len(result["metrics"]) for result in stored.values())
    for line in table.to_dict("records"):
        result = stored[line["key"]]
        value = result["metrics"][line["metric"]]["value"]
        if value is None:
            assert pd.isna(line["value"]), line
        else:
            assert line["value"] == value, line["metric"]
        assert line["seed"] == result["cell"]["seed"]
        assert line["variant.detach"] == result["cell"]["variant"]["detach"]
        assert (
            line["guards.faint_surfels"] == sum(each["faint_surfels"] for each in result["guards"].values() if each) > 0
        )
        assert line["work.steps"] == sum(counters.get("steps", 0) for counters in result["work"].values())


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
    place = REQUEST.manifest([place for place, _ in REQUEST.cells()])["cells"][0]
    result = store.store.result(place["key"])
    assert result is not None
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
