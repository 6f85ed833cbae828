"""Files of others become a row of a finished run, and nothing that is not comparable does."""

import csv
import json
from pathlib import Path
from typing import Any

import pytest

from bench.fake_method import write_sweep
from public_outputs import WRITERS, noisy
from radiogs_bench.cli import main
from radiogs_bench.runs.cell import Cell
from radiogs_bench.runs.plan import planned
from radiogs_bench.runs.result import empty_result
from radiogs_bench.runs.rows_from_files import measured, row_key, with_rows_from_files
from radiogs_bench.runs.spec import RunSpec
from radiogs_bench.runs.sweep import read_sweep
from radiogs_bench.scoring.metrics.protocols import protocol
from radiogs_bench.store.folder import Store
from radiogs_bench.suites.experiment import TRAINING
from radiogs_bench.suites.suite import Metric, Row, Suite
from radiogs_datasets import load_scene
from radiogs_reports.summary import read_summary
from radiogs_reports.tables.suite import suite_table

SUITE = Suite(
    "mine", "Mine", None, "ours",
    (Row("ours", "Ours", "Ours"), Row("no-rad", "", "without", {"radiometric_weight": 0.0})),
    tuple(map(Metric.of, ("nvs/psnr", "albedo/psnr", "roughness/mse", "indirect/psnr", "nvs/ms", "training/seconds"))),
    experiment=TRAINING,
)  # fmt: skip
SCENE = load_scene("corner")
SMOKE = RunSpec(SUITE.name, preset="smoke", protocol="default")
REQUEST = planned(SUITE, {"corner": SCENE}, SMOKE)


def finish(store: Store, cell: Cell, value: float) -> None:
    """Store a measured result without training."""
    result = empty_result(cell, protocol("default").describe())
    for metric in ("nvs/psnr", "albedo/psnr"):
        result["metrics"][metric] = {"value": value, "reason": None, "views": [value] * len(SCENE.test)}
    result["timings"]["nvs/ms"] = {"value": 1.0, "reason": None, "views": [1.0] * len(SCENE.test)}
    result["views"] = [view.name for view in SCENE.test]
    result["seconds"] = {"initialise": 1.0, "invert": 2.0, "evaluate": 1.0}
    result["maps"] = ["image", "albedo"]
    store.put_result(result, {})


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A finished run of two rows on scene corner."""
    store, cells = Store(tmp_path / "out"), REQUEST.cells
    for number, (_, cell) in enumerate(cells):
        finish(store, cell, 20.0 + number)
    write_sweep(store, REQUEST.manifest())
    return store.folder


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("gs-ir")
    WRITERS["gs-ir"](folder, noisy(SCENE))
    return folder


def into(run: Path, files: Path, *further: str, row: str = "GS-IR, 30k", scene: str = "corner") -> int:
    return main(["score", str(files), "--scene", scene, "--into", str(run), "--row", row, *further])


def cell_of_row(run: Path, row: str = "GS-IR, 30k") -> dict[str, Any]:
    (place,) = [place for place in read_sweep(run)["cells"] if place["row"] == row_key(row)]
    return json.loads((run / "cells" / f"{place['key']}.json").read_text())


@pytest.mark.slow
def test_a_row_from_files_has_the_metrics_of_score_in_the_tables(run: Path, files: Path, tmp_path: Path) -> None:
    assert into(run, files) == 0
    record = tmp_path / "score.json"
    assert main(["score", str(files), "--scene", "corner", "--out", str(record)]) == 0
    alone = json.loads(record.read_text())["protocols"]["default"]["metrics"]
    assert cell_of_row(run)["metrics"] == alone
    summary = json.loads((run / "summary.json").read_text())
    shown = summary["cells"][row_key("GS-IR, 30k")]
    assert shown["nvs/psnr"]["mean"] == alone["nvs/psnr"]["value"]
    assert shown["nvs/psnr"]["difference"]["mean"] == pytest.approx(alone["nvs/psnr"]["value"] - 20.0)
    page = (run / "report.html").read_text()
    assert "GS-IR, 30k" in page
    assert "what trained it is not known here" in page
    assert "PNG of 8 bits" in page


@pytest.mark.slow
def test_values_that_a_folder_does_not_hold_are_unknown_and_not_zero(run: Path, files: Path) -> None:
    into(run, files)
    summary = json.loads((run / "summary.json").read_text())
    shown = summary["cells"][row_key("GS-IR, 30k")]
    for column, why in {
        "nvs/ms": "what it took is not known",
        "training/seconds": "what it took is not known",
        "indirect/psnr": "hold no indirect light",
    }.items():
        assert shown[column]["mean"] is None
        assert why in shown[column]["reason"], shown[column]
    (row,) = [row for row in summary["rows"] if row["key"] == row_key("GS-IR, 30k")]
    assert row["seconds"] is None
    with (run / "mine.csv").open() as file:
        lines = [line for line in csv.DictReader(file) if row_key("GS-IR, 30k") in line.values()]
    assert len(lines) == len(SUITE.columns)


@pytest.mark.slow
def test_a_row_of_one_scene_beside_means_of_two_is_marked_in_its_cells(files: Path, tmp_path: Path) -> None:
    request = planned(SUITE, {"corner": SCENE, "convex": load_scene("convex")}, SMOKE)
    store, cells = Store(tmp_path / "two"), request.cells
    for number, (_, cell) in enumerate(cells[:-1]):  # a row that is not finished is not marked
        finish(store, cell, 20.0 + number)
    write_sweep(store, request.manifest())
    assert into(store.folder, files) == 0
    summary = read_summary(store.folder)
    said = "GS-IR, 30k: over corner alone, 1 of 2 scenes and seeds."
    assert {doubt["column"] for doubt in summary["doubts"] if doubt["text"] == said} == {
        "nvs/psnr", "albedo/psnr", "roughness/mse"
    }  # fmt: skip
    *measured_rows, from_files = suite_table(summary).rows
    assert from_files.cells[0].marks
    assert not any(row.cells[0].marks for row in measured_rows)


@pytest.mark.slow
def test_a_row_is_replaced_only_with_force(run: Path, files: Path, tmp_path: Path) -> None:
    assert into(run, files) == 0
    before = cell_of_row(run)
    other = tmp_path / "other"
    WRITERS["plain"](other, noisy(SCENE))
    assert into(run, other) == 2
    assert cell_of_row(run) == before
    assert into(run, other, "--force") == 0
    after = cell_of_row(run)
    assert after["facts"]["read_as"] == "plain"
    assert after["key"] != before["key"]
    assert (run / "cells" / f"{before['key']}.json").exists(), "nothing is lost"


@pytest.mark.slow
def test_files_that_cannot_be_compared_are_refused_and_change_nothing(
    run: Path, files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    manifest, cells = (run / "sweep.json").read_bytes(), sorted((run / "cells").iterdir())
    for further, why in {
        ("--protocol", "radiogs"): "was scored under protocol 'default'",
        ("--seed", "1"): "the run has no seed 1",
        ("--reduce", "2"): "is not the one that",
    }.items():
        assert into(run, files, *further) == 2
        assert why in capsys.readouterr().err
    assert into(run, files, scene="convex") == 2
    assert "has no finished cell of scene 'convex'" in capsys.readouterr().err
    for name in ("Ours", "without", "", "two\nlines", "x" * 81):
        assert into(run, files, row=name) == 2
    assert main(["score", str(files), "--scene", "corner", "--row", "X"]) == 2
    assert ((run / "sweep.json").read_bytes(), sorted((run / "cells").iterdir())) == (manifest, cells)


@pytest.mark.slow
def test_a_run_that_goes_on_keeps_the_row_and_one_that_differs_has_no_such_row(run: Path, files: Path) -> None:
    into(run, files)
    store, fresh = Store(run), REQUEST.manifest()
    kept, outdated = with_rows_from_files(store, fresh, {"corner": SCENE.checksum})
    assert kept == {name: part for name, part in read_sweep(run).items() if name != "seal"}
    assert not outdated
    assert measured(kept) == fresh, "what the gate and the paper's tables read"
    for changed, checksums in (
        ({**fresh, "protocol": "radiogs"}, {"corner": SCENE.checksum}),
        ({**fresh, "seeds": [1]}, {"corner": SCENE.checksum}),
        (fresh, {"corner": "0" * 64}),
    ):
        assert with_rows_from_files(store, changed, checksums)[0]["rows"] == fresh["rows"]  # type: ignore[arg-type]


@pytest.mark.slow
def test_status_verify_and_export_read_the_row(run: Path, files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    into(run, files)
    assert main(["report", str(run)]) == 0
    assert main(["verify", str(run)]) == 0
    capsys.readouterr()
    assert main(["status", str(run)]) == 0
    assert "3 of 3 cells finished" in capsys.readouterr().out
    assert main(["export", str(run)]) == 0
    assert "GS-IR, 30k (files)" in (run / "export.csv").read_text()


def test_names_with_other_characters_have_keys_of_their_own() -> None:
    keys = [row_key(name) for name in ("a b", "a-b", "a/b", "../b", "ω", "日本", "Ours")]
    assert len(set(keys)) == len(keys)
    assert all("/" not in key and key.startswith("files-") and key.isascii() for key in keys)
