"""``export --to wandb``: runs that `wandb sync` sends, written without a network, hold the trail of every cell."""

import json
import struct
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from bench.fake_method import FakeSweep, asked, write_sweep
from radiogs_bench.cli import main
from radiogs_bench.export.loggers import course, end
from radiogs_bench.runs.sweep import label
from radiogs_bench.store.schema import Result

REQUEST = asked(1)
BLOCK = 32_768
"""Bytes of a block of a LevelDB log, which a run's file is."""


@pytest.fixture
def sweep(tmp_path: Path) -> FakeSweep:
    made, cells = FakeSweep(tmp_path), REQUEST.cells
    write_sweep(made.store, REQUEST.manifest())
    made.run([cell for _, cell in cells[:2]])
    return made


@pytest.mark.skipif(find_spec("wandb") is not None, reason="wandb is installed")
def test_without_the_library_it_says_what_to_install(sweep: FakeSweep, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(sweep.store.folder), "--to", "wandb"]) == 2
    assert "pip install 'radiogs-bench[wandb]'" in capsys.readouterr().err


def test_points_of_the_trail_are_named_by_loss_and_metric(sweep: FakeSweep) -> None:
    result = stored(sweep, 0)
    points = list(course(result))
    assert [(point.stage, point.step) for point in points] == [
        (stage, point["iteration"]) for stage, trail in result["trail"].items() for point in trail
    ]
    last = result["trail"][points[-1].stage][-1]
    expected = {f"loss/{name}": value for name, value in last["losses"].items()} | last["metrics"]
    assert points[-1].values == expected
    assert end(result)["nvs/psnr"] == result["metrics"]["nvs/psnr"]["value"]
    assert None not in end(result).values()


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
    place, result = REQUEST.cells[0][0], stored(sweep, 0)
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
    assert {name: last[name] for name in end(result)} == pytest.approx(end(result))


def stored(sweep: FakeSweep, number: int) -> Result:
    result = sweep.store.result(REQUEST.cells[number][1].key)
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
