"""The summary's figures equal the stored ones: means, paired differences, and reasons for missing values."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from bench.fake_method import FakeSweep, asked
from radiogs_bench.results.summary import error_parts, plan_summary, summarise
from radiogs_bench.runs.sweep import CellRef
from radiogs_bench.scoring.metrics.weights import NO_WEIGHTS, missing_weights
from radiogs_bench.store.folder import Store
from radiogs_bench.store.schema import MetricValue, values_of
from radiogs_bench.suites.paper import ABLATIONS
from radiogs_core.errors import DataError
from radiogs_reports.summary import Summary

REQUEST = asked(3)
PLACES = [place for place, _ in REQUEST.cells]
PUBLISHED = {"ours": {"nvs/psnr": 37.86}}


@pytest.fixture
def sweep(tmp_path: Path) -> FakeSweep:
    sweep = FakeSweep(tmp_path)
    cells = [cell for _, cell in REQUEST.cells]
    sweep.run(cells[:-1])  # the last row lacks its last seed
    return sweep


def test_means_and_differences_follow_from_the_stored_results(sweep: FakeSweep) -> None:
    summary = summarise(sweep.store, REQUEST.manifest(), PUBLISHED, "four scenes")
    stored = {
        (place["row"], place["seed"]): result["metrics"]["nvs/psnr"]["value"]
        for place in PLACES
        if (result := sweep.store.result(place["key"])) is not None
    }
    ours = [stored["ours", seed] for seed in range(3)]
    initialised = [stored["nvs-init", seed] for seed in range(2)]
    found = summary["cells"]["nvs-init"]["nvs/psnr"]
    assert found["mean"] == pytest.approx(sum(initialised) / 2)
    assert found["count"] == 2
    assert found["difference"] is not None
    assert found["difference"]["mean"] == pytest.approx(sum(initialised) / 2 - sum(ours[:2]) / 2)
    assert found["reason"] == "fake seed 2 is not finished"
    assert summary["cells"]["ours"]["nvs/psnr"]["mean"] == pytest.approx(sum(ours) / 3)
    assert summary["cells"]["ours"]["nvs/psnr"]["difference"] is None
    assert summary["published"] == PUBLISHED


def test_values_by_two_versions_of_a_protocol_are_not_put_into_one_table(sweep: FakeSweep) -> None:
    stored = sweep.store.result(PLACES[0]["key"])
    assert stored is not None
    stored["protocol"] |= {"title": "fake@2"}
    sweep.store.put_result(stored, {})
    with pytest.raises(DataError, match="are by fake and fake@2"):
        summarise(sweep.store, REQUEST.manifest(), PUBLISHED, "four scenes")


def test_lpips_that_no_row_has_for_lack_of_weights_is_left_out_with_the_reason(sweep: FakeSweep) -> None:
    manifest = REQUEST.manifest()
    reason = missing_weights("alex") or f"{NO_WEIGHTS} of alex were not found"

    def stored(value: float | None, places: Sequence[CellRef]) -> Summary:
        for place in places:
            result = sweep.store.result(place["key"])
            if result is not None:
                result["metrics"]["nvs/lpips"] = MetricValue(value=value, reason=None if value else reason, views=[])
                sweep.store.put_result(result, {})
        return summarise(sweep.store, manifest, PUBLISHED, "four scenes")

    without = stored(None, PLACES)
    assert [column["key"] for column in without["columns"]] == [
        key for key in manifest["columns"] if "lpips" not in key
    ]
    assert f"NVS LPIPS is left out: {reason}." in [doubt["text"] for doubt in without["doubts"]]
    one_row_has_it = stored(0.1, PLACES[:1])
    assert [column["key"] for column in one_row_has_it["columns"]] == manifest["columns"]
    assert not any("left out" in doubt["text"] for doubt in one_row_has_it["doubts"])


def test_means_are_over_kinds_of_scenes_and_intervals_state_their_units(sweep: FakeSweep) -> None:
    manifest = REQUEST.manifest()
    manifest["scenes"], manifest["seeds"] = ["ball", "bowl", "niche"], [0]
    manifest["cells"] = [{**place, "scene": manifest["scenes"][place["seed"]], "seed": 0} for place in PLACES]
    values = [
        result["metrics"]["nvs/psnr"]["value"]
        for place in PLACES
        if place["row"] == "ours" and (result := sweep.store.result(place["key"])) is not None
    ]
    ball, bowl, niche = (value for value in values if value is not None)
    scenes = summarise(sweep.store, manifest, PUBLISHED, "four scenes")
    assert scenes["cells"]["ours"]["nvs/psnr"]["mean"] == pytest.approx((ball + bowl + niche) / 3)
    manifest["kinds"] = {"ball": "round", "bowl": "round", "niche": "front"}
    kinds = summarise(sweep.store, manifest, PUBLISHED, "four scenes")
    assert kinds["cells"]["ours"]["nvs/psnr"]["mean"] == pytest.approx(((ball + bowl) / 2 + niche) / 2)
    assert kinds["kinds"] == manifest["kinds"]
    for made, over, units in ((scenes, "scenes", 3), (kinds, "kinds", 2)):
        difference = made["cells"]["no-rad"]["nvs/psnr"]["difference"]
        assert difference is not None
        assert (difference["over"], difference["units"]) == (over, units)
        assert over in difference["spread"]


def test_values_of_views_are_kept_where_there_are_any(sweep: FakeSweep) -> None:
    summary = summarise(sweep.store, REQUEST.manifest(), PUBLISHED, "four scenes")
    result = sweep.store.result(PLACES[0]["key"])
    assert result is not None
    run = summary["runs"][0]
    assert run["views"] == result["views"]
    assert run["by_view"]["nvs/psnr"] == pytest.approx(result["metrics"]["nvs/psnr"]["views"], rel=1e-5)
    assert all(any(value is not None for value in values) for values in run["by_view"].values())
    assert "views" not in summary["runs"][-1], "an unfinished cell has none"


def test_the_memory_of_training_is_the_largest_peak_of_its_stages(sweep: FakeSweep) -> None:
    result = sweep.store.result(PLACES[0]["key"])
    assert result is not None
    for stage, peaks in (("initialise", (2e9, 3e9)), ("invert", (1e9,)), ("evaluate", (9e9,))):
        (session,) = result["sessions"][stage]
        result["sessions"][stage] = [{**session, "peak_memory_bytes": {"host": int(peak)}} for peak in peaks]
    assert values_of(result)["training/megabytes"]["value"] == 3000
    result["sessions"]["invert"][0]["peak_memory_bytes"]["device"] = int(5e8)
    result["sessions"]["initialise"] = []
    assert values_of(result)["training/megabytes"]["value"] == 500
    result["sessions"] = {"evaluate": result["sessions"]["evaluate"]}
    assert "training/megabytes" not in values_of(result)


def test_a_plan_comes_with_its_bound_and_the_cost_of_probes(sweep: FakeSweep) -> None:
    result = sweep.store.result(PLACES[0]["key"])
    assert result is not None
    plain = plan_summary(result)
    assert plain is not None
    assert plain["plan"]["visibility"]
    assert (plain["bound"], plain["tolerance"], plain["probing"]) == (None, None, {"seconds": 6.0, "rays": 0})
    result["facts"]["effects"]["evidence"] = [
        {"tolerance": 0.0},
        {"tolerance": 0.1},
    ]  # a probe that failed tolerates nothing
    result["metrics"]["plan/bound"] = {"value": 0.03, "reason": None, "views": []}
    result["parts"]["invert"], result["work"]["invert"]["probe_rays"] = {}, 7
    probed = plan_summary(result)
    assert probed is not None
    assert (probed["bound"], probed["tolerance"]) == (0.03, 0.1)
    assert probed["probing"] == {"seconds": 0.0, "rays": 7}
    for unlike in ({"plan": {}}, {"plan": {}, "evidence": [{}]}, {"evidence": []}, ["plan"]):
        result["facts"]["effects"] = unlike
        assert plan_summary(result) is None, "a fact of that name which holds no plan"
    del result["facts"]["effects"]
    assert plan_summary(result) is None


def test_a_metric_that_no_result_has_gives_its_reason(sweep: FakeSweep) -> None:
    summary = summarise(sweep.store, REQUEST.manifest(), PUBLISHED, "four scenes")
    found = summary["cells"]["ours"]["albedo/psnr"]
    assert found == {
        "mean": None,
        "count": 0,
        "difference": None,
        "reason": "fake has no ground truth for it",
        "rank": None,
    }


def test_the_sheet_shows_the_first_seed_of_every_row_that_is_there(sweep: FakeSweep, tmp_path: Path) -> None:
    summary = summarise(sweep.store, REQUEST.manifest(), PUBLISHED, "four scenes")
    assert [entry["row"] for entry in summary["sheet"]] == [row.key for row in ABLATIONS.rows]
    assert all((tmp_path / entry["arrays"]).exists() for entry in summary["sheet"])
    assert len(summary["keys"]) == 14


def test_an_empty_store_gives_a_summary_without_figures(tmp_path: Path) -> None:
    summary = summarise(FakeSweep(tmp_path).store, REQUEST.manifest(), PUBLISHED, "four scenes")
    assert summary["sheet"] == []
    assert all(figure["mean"] is None for row in summary["cells"].values() for figure in row.values())


def test_an_error_is_split_into_variance_over_seeds_and_a_shared_part(tmp_path: Path) -> None:
    """A bias of 30 levels and noise of 20 give 30^2 + 20^2; one seed, one side alone and other maps give nothing."""
    store, generator = Store(tmp_path), np.random.default_rng(3)
    truth = np.full((64, 64, 3), 100, np.uint8)
    finished = []
    for row, seeds in (("several", 12), ("single", 1)):
        for seed in range(seeds):
            key = f"{row}{seed}"
            noise = 20 * generator.choice([-1, 1], truth.shape)
            shown = (truth.astype(int) + 30 + noise).astype(np.uint8)
            arrays = {
                "views/0/render/relit/sun": shown,
                "views/0/truth/relit/sun": truth,
                "views/1/render/image": shown,
            }
            store.arrays_path(key).parent.mkdir(exist_ok=True)
            np.savez(store.arrays_path(key), **arrays)
            finished.append((CellRef(row=row, scene="s", seed=seed, key=key, stages=[]), {"key": key}))
    parts = error_parts(store, finished)  # type: ignore[arg-type]
    assert {row: list(kinds) for row, kinds in parts.items()} == {"several": ["relit"]}
    found = parts["several"]["relit"]
    assert found["error"] * 255**2 == pytest.approx(30**2 + 20**2, rel=0.01)
    assert found["variance"] * 255**2 == pytest.approx(20**2, rel=0.01)
    assert found["scenes"] == 1
