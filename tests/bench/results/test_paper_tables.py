"""The paper's tables take from a store what belongs to their rows, and nothing else."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bench.fake_method import FakeSweep, asked, scene_of
from radiogs.settings import PRESETS
from radiogs_baselines.published import published
from radiogs_bench.results.paper_tables import paper_tables, ran, value_of, why_not
from radiogs_bench.runs.plan import RunPlan
from radiogs_bench.runs.rows import with_settings
from radiogs_bench.suites.paper import ABLATIONS, NG, VIEWS
from radiogs_bench.suites.suite import Suite
from radiogs_core.scene.scene import Scene
from radiogs_reports.summary import PaperTable

PRINTED = replace(ABLATIONS, recipe="printed")
"""The paper's ablations by its own values; by default the recommended recipe's values are used."""


def request(suite: Suite = PRINTED, preset: str = "smoke", seeds: int = 2) -> RunPlan:
    return asked(seeds, suite, preset)


def run(sweep: FakeSweep, plan: RunPlan) -> Mapping[str, PaperTable]:
    """Run what is asked for; the tables of the store by key."""
    sweep.run([cell for _, cell in plan.cells])
    return {table["key"]: table for table in paper_tables(sweep.store, plan.manifest())}


def stored(sweep: FakeSweep, asked: RunPlan, row: str) -> list[float]:
    places = [place for place, _ in asked.cells if place["row"] == row]
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


def test_a_row_on_another_scene_or_budget_states_its_conditions(sweep: FakeSweep) -> None:
    """The numbers in a label are the measured row's, not the paper's."""
    budget = PRESETS["smoke"]
    numbers = f"preset smoke, N_g {budget.consistency_surfels}, N_s {budget.incident_samples}; fake; 40 x 40; CPU"
    labels = {row["key"]: row["ran"] for row in run(sweep, request())["ablation"]["rows"]}
    assert labels["no-rad"] == f"λ_rad = 0: {numbers}"
    labels = {row["key"]: row["ran"] for row in run(sweep, request(replace(NG, recipe="printed")))["ng"]["rows"]}
    quarter = budget.consistency_surfels // 4
    assert labels["ng-1024"].startswith(f"N_g = {quarter} (paper: 1024): preset smoke, N_g {quarter},")
    assert labels["ng-8192"].startswith(f"N_g = {2 * budget.consistency_surfels} (paper: 8192)")


def test_a_run_on_another_scene_fills_its_own_table_alone(sweep: FakeSweep) -> None:
    assert run(sweep, request()).keys() == {"ablation"}


NAMES = published("ablation").conditions.scenes


def tensoir(names: Sequence[str] = NAMES, layout: str = "tensoir", width: int = 800) -> list[Scene]:
    return [scene_of(name, layout, width) for name in names]


def run_on(folder: Path, scenes: Sequence[Scene], suite: Suite = PRINTED, **settings: Any) -> Mapping[str, PaperTable]:
    """Tables after a run with the paper's budget and protocol, but for the settings."""
    given = {"seeds": 1, "preset": "paper", "protocol": "radiogs"} | settings
    return run(FakeSweep(folder, *scenes), asked(suite=suite, scenes={scene.name: scene for scene in scenes}, **given))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, PaperTable]:
    """Tables after a run under all of the paper's conditions."""
    return run_on(tmp_path_factory.mktemp("whole"), tensoir())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenes", "settings"),
    [
        (tensoir(NAMES[1:]), {}),
        (tensoir((*NAMES, "corner")), {}),
        (tensoir(width=400), {}),
        (tensoir(layout="colmap"), {}),
        (tensoir(), {"preset": "small"}),
    ],
    ids=["a scene is missing", "another scene", "smaller images", "another layout", "a smaller budget"],
)
def test_a_row_has_the_papers_label_only_under_all_of_its_conditions(
    whole: Mapping[str, PaperTable], tmp_path: Path, scenes: list[Scene], settings: dict[str, Any]
) -> None:
    other = run_on(tmp_path, scenes, **settings)
    assert {row["ran"] for row in whole["ablation"]["rows"]} == {""}
    assert all(row["ran"] for row in other["ablation"]["rows"])
    assert whole.keys() > other.keys() == {"ablation"}


def test_a_set_field_takes_the_papers_label_from_the_rows_that_it_changes(tmp_path: Path) -> None:
    scenes, (suite, _) = tensoir(), with_settings(PRINTED, {"radiometric_weight": 0.1}, "paper")
    plan = asked(1, suite, "paper", {scene.name: scene for scene in scenes}, "radiogs")
    ran = {row["key"]: row["ran"] for row in run(FakeSweep(tmp_path, *scenes), plan)["ablation"]["rows"]}
    assert ran.pop("no-rad") == "", "it sets the field itself"
    assert all(": radiometric_weight = 0.1; preset paper, N_g" in label for label in ran.values())


@pytest.mark.parametrize("recipe", ["recommended", "released"])
def test_only_rows_by_the_printed_recipe_have_the_papers_label_and_fill_its_other_tables(
    tmp_path: Path, recipe: str
) -> None:
    """The values of ``released`` differ between the scenes."""
    tables = run_on(tmp_path, tensoir(), replace(ABLATIONS, recipe=recipe))
    ran = {row["key"]: row["ran"] for row in tables["ablation"]["rows"]}
    assert ran["ours"].startswith(f"Ours: recipe {recipe}; preset paper, N_g 4,096")
    assert ran["no-rad"].startswith(f"λ_rad = 0: recipe {recipe}; preset paper")
    assert tables.keys() == {"ablation"}


def test_a_default_row_with_a_set_field_is_labelled_with_both(tmp_path: Path) -> None:
    scenes, (suite, _) = tensoir(), with_settings(ABLATIONS, {"materials.weights.mask": 0.5}, "paper")
    ran = {row["key"]: row["ran"] for row in run_on(tmp_path, scenes, suite)["ablation"]["rows"]}
    assert ran["ours"].startswith("Ours: recipe recommended; materials.weights.mask = 0.5; preset paper")


def test_a_row_run_by_another_method_states_it_without_that_method(sweep: FakeSweep) -> None:
    """A suite of one's own may give the rows of a published table to methods of other names and with other fields."""
    mine = request()
    sweep.run([cell for _, cell in mine.cells])
    result = next(sweep.store.results())
    result["cell"]["method"] = "elsewhere"
    no_rad = next(row for row in ABLATIONS.rows if row.key == "no-rad")
    assert ran([result], published("ablation"), no_rad).startswith("λ_rad = 0: method elsewhere; preset smoke, N_g")


def test_values_by_other_conventions_are_marked(whole: Mapping[str, PaperTable], tmp_path: Path) -> None:
    mine = whole["ablation"]["columns"]
    others = run_on(tmp_path, tensoir(), protocol="default")["ablation"]["columns"]
    assert not any("published_by" in column for column in mine)
    assert {column.get("published_by") for column in others} == {"radiogs"}


def test_cpu_times_do_not_fill_a_table_of_the_paper(whole: Mapping[str, PaperTable]) -> None:
    assert "ng" not in whole, "table ng has a column of milliseconds"


def test_other_tables_reuse_shared_rows_and_say_how_to_measure_missing_ones(whole: Mapping[str, PaperTable]) -> None:
    assert whole.keys() == {"ablation", "init", "indirect", "views", "strategies"}
    init, own = whole["init"]["cells"], whole["ablation"]["cells"]
    assert init["nvs-init"]["nvs/psnr"]["mean"] == own["nvs-init"]["nvs/psnr"]["mean"]
    lacking = init["nvs-init-no-rad"]["nvs/psnr"]
    assert lacking["mean"] is None
    assert lacking["reason"] == "not in this store by this run's preset and code; radiogs-bench run init measures it"
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
    sweep.run([cell for _, cell in request(preset="tiny").cells])
    sweep.run([cell for _, cell in request(seeds=3).cells])
    after = {table["key"]: table for table in paper_tables(sweep.store, asked.manifest())}
    assert after == before


def test_changes_are_relative_to_all_views_and_hours_count_training(sweep: FakeSweep) -> None:
    asked = request(VIEWS)
    tables = run(sweep, asked)
    found = tables["views"]["cells"]["no-rad-25"]["nvs/change"]["mean"]
    expected = (sum(stored(sweep, asked, "no-rad-25")) - sum(stored(sweep, asked, "no-rad-100"))) / 2
    assert found == pytest.approx(expected)
    assert tables["views"]["cells"]["ours-100"]["nvs/change"]["reason"] == "The change is relative to this row."
    for result in sweep.store.results():
        seconds = result["seconds"]["initialise"] + result["seconds"]["invert"]
        assert value_of(result, "training", "hours") == pytest.approx(seconds / 3600)


def test_an_empty_store_fills_no_table(sweep: FakeSweep) -> None:
    assert paper_tables(sweep.store, request().manifest()) == []
