"""The paper's tables take from a store what belongs to their rows, and nothing else."""

from collections.abc import Mapping
from pathlib import Path

import pytest

from bench.fake_method import FakeSweep, asked
from radiogs.budget import PRESETS
from radiogs_baselines.published import published
from radiogs_bench.results.paper_tables import paper_tables, why_not
from radiogs_bench.suites.paper import ABLATIONS, VIEWS
from radiogs_bench.suites.suite import Suite
from radiogs_bench.suites.sweep import Request, Sweep
from radiogs_reports.summary import PaperTable


def request(suite: Suite = ABLATIONS, preset: str = "smoke", seeds: int = 2) -> Request:
    return asked(seeds, suite, preset)


def run(sweep: FakeSweep, asked: Request) -> Mapping[str, PaperTable]:
    """Run what is asked for; the tables of the store by key."""
    sweep.run([cell for _, cell in asked.cells()])
    return {table["key"]: table for table in paper_tables(sweep.store, manifest(asked))}


def manifest(asked: Request) -> Sweep:
    return asked.manifest([place for place, _ in asked.cells()])


def stored(sweep: FakeSweep, asked: Request, row: str) -> list[float]:
    places = [place for place, _ in asked.cells() if place["row"] == row]
    results = [sweep.store.result(place["key"]) for place in places]
    return [result["metrics"]["nvs/psnr"]["value"] for result in results if result is not None]  # type: ignore[misc]


@pytest.fixture
def sweep(tmp_path: Path) -> FakeSweep:
    return FakeSweep(tmp_path)


def test_the_suites_own_table_has_its_means_and_paired_differences(sweep: FakeSweep) -> None:
    asked = request()
    cells = run(sweep, asked)["ablation"]["cells"]
    for row in ABLATIONS.rows:
        values = stored(sweep, asked, row.key)
        figure = cells[row.key]["nvs/psnr"]
        assert figure["mean"] == pytest.approx(sum(values) / 2)
        assert figure["published"] == published("ablation").printed[row.key]["nvs/psnr"]
    ours, detached = stored(sweep, asked, "ours"), stored(sweep, asked, "detach-pbr")
    difference = cells["detach-pbr"]["nvs/psnr"]["difference"]
    assert difference is not None
    assert difference["mean"] == pytest.approx(sum(detached) / 2 - sum(ours) / 2)


def test_other_tables_have_the_rows_that_they_share_and_say_how_to_get_the_others(sweep: FakeSweep) -> None:
    asked = request()
    tables = run(sweep, asked)
    assert {"ablation", "init", "indirect", "ng", "ns", "views", "tensoir", "strategies"} <= tables.keys()
    assert "relight-cost" not in tables  # it has no row of which anything was measured
    assert "mipnerf360-ng" not in tables
    init = tables["init"]["cells"]
    assert init["nvs-init"]["nvs/psnr"]["mean"] == pytest.approx(sum(stored(sweep, asked, "nvs-init")) / 2)
    lacking = init["nvs-init-no-rad"]["nvs/psnr"]
    assert lacking["mean"] is None
    assert lacking["reason"] == "not in this store by this run's preset and code; radiogs-bench run init measures it"
    assert tables["ng"]["cells"]["ng-4096"]["nvs/psnr"]["mean"] is not None, "the full method is that of the text"
    assert tables["ng"]["cells"]["ng-2048"]["nvs/psnr"]["mean"] is None
    remarks = {row["key"]: row["remark"] for row in tables["ng"]["rows"]}
    assert remarks["ng-4096"] == f"Measured: N_g = {PRESETS['smoke'].consistency_surfels} (paper: 4096)."
    assert remarks["ng-2048"] == ""
    assert tables["ng"]["cells"]["ng-1024"]["nvs/psnr"]["mean"] is None
    assert why_not({}, "gs-ir", "nvs/psnr", ABLATIONS) == "no suite runs this row"


def test_every_table_has_all_rows_and_columns_of_the_paper_and_a_reason_for_each_lack(sweep: FakeSweep) -> None:
    for key, table in run(sweep, request()).items():
        paper = published(key)
        assert [column["key"] for column in table["columns"]] == list(paper.columns)
        assert [row["text"] for row in table["rows"]] == list(paper.labels.values())
        for row, cells in table["cells"].items():
            for column, figure in cells.items():
                assert (figure["mean"] is None) == (figure["reason"] is not None)
                assert (figure["published"] is None) == (figure["absent"] is not None)
                assert figure["published"] == paper.printed[row].get(column)


def test_results_of_another_preset_seed_or_suite_stay_out(sweep: FakeSweep) -> None:
    asked = request(seeds=1)
    before = run(sweep, asked)
    sweep.run([cell for _, cell in request(preset="tiny").cells()])
    sweep.run([cell for _, cell in request(seeds=3).cells()])
    after = {table["key"]: table for table in paper_tables(sweep.store, manifest(asked))}
    assert after == before


def test_changes_are_to_all_views_and_hours_are_those_of_training(sweep: FakeSweep) -> None:
    asked = request(VIEWS)
    tables = run(sweep, asked)
    found = tables["views"]["cells"]["no-rad-25"]["nvs/change"]["mean"]
    expected = (sum(stored(sweep, asked, "no-rad-25")) - sum(stored(sweep, asked, "no-rad-100"))) / 2
    assert found == pytest.approx(expected)
    assert tables["views"]["cells"]["ours-100"]["nvs/change"]["reason"] == "The change is relative to this row."
    seconds = [
        result["seconds"]["initialise"] + result["seconds"]["invert"]
        for place, _ in asked.cells()
        if place["row"] == "ours-100" and (result := sweep.store.result(place["key"])) is not None
    ]
    assert tables["tensoir"]["cells"]["ours"]["training/hours"]["mean"] == pytest.approx(sum(seconds) / 2 / 3600)


def test_an_empty_store_fills_no_table(sweep: FakeSweep) -> None:
    assert paper_tables(sweep.store, manifest(request())) == []
