"""Results for tables, TensorBoard and wandb."""

import json
import struct
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import radiogs_bench as rb
from bench.fake_method import FakeSweep, asked, write_sweep
from radiogs_bench.cli import main
from radiogs_bench.export.loggers import course
from radiogs_bench.export.records import export
from radiogs_bench.runs.sweep import label, read_sweep
from radiogs_bench.store.folder import Store
from radiogs_bench.store.schema import Result, known_values

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


@pytest.mark.parametrize(
    ("form", "library"), [("parquet", "pyarrow"), ("tensorboard", "torch.utils.tensorboard"), ("wandb", "wandb")]
)
def test_a_library_that_is_missing_is_named_before_a_cell_is_read(
    form: str, library: str, sweep: FakeSweep, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    read: list[str] = []
    monkeypatch.setitem(sys.modules, library, None)
    monkeypatch.setattr(Store, "result", lambda store, key: read.append(key))
    assert main(["export", str(sweep.store.folder), "--to", form]) == 2
    assert f"pip install 'radiogs-bench[{form}]'" in capsys.readouterr().err
    assert read == []


@pytest.mark.skipif(find_spec("pyarrow") is None, reason="needs pyarrow: pip install 'radiogs-bench[parquet]'")
def test_a_table_in_parquet_has_a_line_for_every_metric(store: FakeSweep) -> None:
    assert main(["export", str(store.store.folder), "--to", "parquet"]) == 0
    assert len(pd.read_parquet(store.store.folder / "export.parquet")) == 10


def test_reading_tells_how_many_cells_are_done(sweep: FakeSweep, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    export(sweep.store, tmp_path / "export.csv", "csv", lambda done, total: told.append((done, total)))
    assert told == [(1, 2), (2, 2)]


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


ONE_SEED = asked(1)
BLOCK = 32_768
"""Bytes of a block of a LevelDB log, which a run's file is."""


@pytest.fixture
def sweep(tmp_path: Path) -> FakeSweep:
    made, cells = FakeSweep(tmp_path), ONE_SEED.cells
    write_sweep(made.store, ONE_SEED.manifest())
    made.run([cell for _, cell in cells[:2]])
    return made


def test_points_of_the_trail_are_named_by_loss_and_metric(sweep: FakeSweep) -> None:
    result = stored(sweep, 0)
    points = list(course(result))
    assert [(point.stage, point.step) for point in points] == [
        (stage, point["iteration"]) for stage, trail in result["trail"].items() for point in trail
    ]
    last = result["trail"][points[-1].stage][-1]
    expected = {f"loss/{name}": value for name, value in last["losses"].items()} | last["metrics"]
    assert points[-1].values == expected
    assert known_values(result["metrics"])["nvs/psnr"] == result["metrics"]["nvs/psnr"]["value"]
    assert None not in known_values(result["metrics"]).values()


@pytest.mark.skipif(find_spec("wandb") is None, reason="needs wandb: pip install 'radiogs-bench[wandb]'")
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_a_run_written_offline_holds_settings_course_and_end(
    sweep: FakeSweep, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("WANDB_MODE", "WANDB_PROJECT", "WANDB_API_KEY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("WANDB_ERROR_REPORTING", "false")
    folder = sweep.store.folder
    assert main(["export", str(folder), "--to", "wandb"]) == 0
    assert f"{folder / 'wandb'}: progress of 2 cells" in capsys.readouterr().out
    place, result = ONE_SEED.cells[0][0], stored(sweep, 0)
    (file,) = (folder / "wandb").glob(f"offline-run-*-{place['key']}/run-{place['key']}.wandb")
    begun, steps, last = read(file)
    assert begun["name"] == label(place)
    assert begun["config"]["variant"]["detach"] == result["cell"]["variant"]["detach"]
    assert begun["config"]["seed"] == 0
    points = list(course(result))
    assert len(steps) == len(points) > 0
    for found, point in zip(steps, points, strict=True):
        assert found[f"{point.stage}/step"] == point.step
        for name, value in point.values.items():
            assert found[f"{point.stage}/{name}"] == pytest.approx(value)
    ended = known_values(result["metrics"])
    assert {name: last[name] for name in ended} == pytest.approx(ended)


def stored(sweep: FakeSweep, number: int) -> Result:
    result = sweep.store.result(ONE_SEED.cells[number][1].key)
    assert result is not None
    return result


def read(file: Path) -> tuple[dict[str, Any], list[dict[str, Any]], dict[str, Any]]:
    """Name and config, every step that was logged, and the summary of a run, from wandb's own records."""
    from wandb.proto.wandb_internal_pb2 import Record

    begun: dict[str, Any] = {}
    steps: list[dict[str, Any]] = []
    last: dict[str, Any] = {}
    for content in log_records(file.read_bytes()):
        record = Record.FromString(content)
        kind = record.WhichOneof("record_type")
        if kind == "run" and not begun:
            config = {item.key: json.loads(item.value_json) for item in record.run.config.update}
            begun = {"name": record.run.display_name, "config": config}
        elif kind == "history":
            values = {
                item.key or "/".join(item.nested_key): json.loads(item.value_json) for item in record.history.item
            }
            steps.append({key: value for key, value in values.items() if not key.startswith("_")})
        elif kind == "summary":
            last |= {
                item.key or "/".join(item.nested_key): json.loads(item.value_json) for item in record.summary.update
            }
    return begun, steps, last


def log_records(data: bytes) -> Iterator[bytes]:
    """The records of a LevelDB log: blocks of pieces with checksum, length, and whether a piece is whole or a part."""
    place, parts = 7, b""  # wandb's own header
    while place + 7 <= len(data):
        if BLOCK - place % BLOCK < 7:
            place += BLOCK - place % BLOCK
            continue
        _, length, kind = struct.unpack_from("<IHB", data, place)
        parts += data[place + 7 : place + 7 + length]
        place += 7 + length
        if kind in (1, 4):  # whole, or the last part
            yield parts
            parts = b""
