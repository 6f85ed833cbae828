"""The gate lets an unchanged run through, every time, and gains; it stops losses and changes of what is computed."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bench.fake_method import finished_sweep
from bench.gate_files import put, sealed_by_hand
from radiogs_bench.cli import main
from radiogs_bench.results.baseline import BAND, baseline_of
from radiogs_bench.results.gate import compare
from radiogs_bench.runs.sweep import read_sweep
from radiogs_bench.store.folder import Store
from radiogs_core.errors import DataError

SEED_1 = ("cells", "fake ours seed 1")


def test_an_unchanged_tree_passes_every_time(
    baseline: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for repetition in range(3):
        again = finished_sweep(tmp_path / f"again{repetition}", seeds=3)
        assert main(["gate", str(again), "--baseline", str(baseline)]) == 0
    assert "regression" not in capsys.readouterr().out


def test_bands_are_the_spread_over_seeds(finished: Path) -> None:
    store, sweep = Store(finished), read_sweep(finished)
    content = baseline_of(store, sweep)
    values = [content["cells"][f"fake ours seed {seed}"]["metrics"]["nvs/psnr"] for seed in range(3)]
    mean = sum(values) / 3
    deviation = (sum((value - mean) ** 2 for value in values) / 2) ** 0.5
    assert content["bands"]["fake ours"]["nvs/psnr"] == pytest.approx(BAND * deviation)


def test_one_more_step_is_a_change_that_may_be_accepted(
    finished: Path, baseline: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sealed_by_hand(baseline, put(5, *SEED_1, "work", "invert", "steps"))
    assert main(["gate", str(finished), "--baseline", str(baseline)]) == 1
    assert "changed: fake ours: stage invert: more work, steps: 17 -> 18 (+5.88 %)" in capsys.readouterr().out
    assert main(["gate", str(finished), "--baseline", str(baseline), "--accept-changes"]) == 0


def test_on_another_machine_counters_warn_and_figures_still_stop(
    finished: Path, baseline: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sealed_by_hand(baseline, put("another", "machine", "cpu"))
    sealed_by_hand(baseline, put(7, *SEED_1, "work", "invert", "steps"))
    assert main(["gate", str(finished), "--baseline", str(baseline)]) == 0
    assert "warning: fake ours: stage invert: less work, steps" in capsys.readouterr().out
    sealed_by_hand(baseline, put(1000.0, *SEED_1, "metrics", "nvs/psnr"))
    assert main(["gate", str(finished), "--baseline", str(baseline)]) == 1


def test_without_a_rerun_a_loss_beyond_the_band_is_a_regression_and_a_gain_is_not(
    finished: Path, baseline: Path
) -> None:
    store, sweep = Store(finished), read_sweep(finished)
    content = json.loads(baseline.read_text())
    content["machine"]["cpu"] = "another"
    band = content["bands"]["fake ours"]["nvs/psnr"]
    for share, severities in ((0.9, []), (1.1, ["regression"]), (-1.1, ["better"])):
        moved = json.loads(json.dumps(content))
        moved["cells"]["fake ours seed 0"]["metrics"]["nvs/psnr"] += share * band
        changes = [each for each in compare(store, sweep, moved) if each.severity not in ("warning", "remark")]
        assert [each.severity for each in changes] == severities
        assert all(("better by" if each.severity == "better" else "worse by") in each.what for each in changes)


def test_a_metric_that_vanished_and_a_cell_that_is_missing_are_regressions(
    finished: Path, baseline: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sealed_by_hand(baseline, put(1.0, "bands", "fake ours", "albedo/psnr"))
    sealed_by_hand(baseline, put(30.0, *SEED_1, "metrics", "albedo/psnr"))
    cells = json.loads(baseline.read_text())["cells"]
    sealed_by_hand(baseline, put(cells["fake ours seed 1"], "cells", "fake ours seed 9"))
    assert main(["gate", str(finished), "--baseline", str(baseline)]) == 1
    said = capsys.readouterr().out
    assert "albedo/psnr: 30 -> n/a" in said
    assert "fake ours seed 9: has no finished result" in said


@pytest.mark.parametrize(("factor", "said"), [(1.05, None), (1.15, "slower"), (1.4, "slower"), (0.8, "faster")])
def test_a_longer_time_is_a_remark_and_fails_where_that_is_asked_for(
    factor: float, said: str | None, finished: Path, baseline: Path
) -> None:
    content = json.loads(baseline.read_text())
    for cell in content["cells"].values():
        cell["pace"] /= factor
    store, sweep = Store(finished), read_sweep(finished)
    for fails in (False, True):
        found = [each for each in compare(store, sweep, content, fails) if "time" in each.what]
        assert [each.what.partition(":")[0] for each in found] == ([] if said is None else [said])
        assert [each.severity == "regression" for each in found] == [fails and factor > 1.3] * (said is not None)


def test_time_to_quality_is_a_remark_and_never_stops(
    finished: Path, baseline: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A metric that came near its final value after 5 s here, and after 4 in the baseline."""
    monkeypatch.setattr(Store, "sealed_result", _with_trail(Store.sealed_result))
    assert main(["gate", str(finished), "--baseline", str(baseline)]) == 0
    assert "remark: fake ours seed 1: near their final values: nvs/psnr after 5.0 s\n" in capsys.readouterr().out
    assert baseline_of(Store(finished), read_sweep(finished))["cells"]["fake ours seed 1"]["settled"] == {"nvs/psnr": 5}
    sealed_by_hand(baseline, put({"nvs/psnr": 4.0}, *SEED_1, "settled"))
    assert main(["gate", str(finished), "--baseline", str(baseline)]) == 0
    assert "nvs/psnr after 5.0 s (4.0 before)" in capsys.readouterr().out


def _with_trail(read: Callable[[Store, str], Any]) -> Callable[[Store, str], Any]:
    """Results whose last stage was scored after 2, 5 and 9 s; the stages before it took no time."""

    def scored(store: Store, key: str) -> Any:
        result = read(store, key)
        last = result["stages"][-1]["name"]
        scores = ((2, 10.0), (5, 29.5), (9, 30.0))
        points = [
            {**point, "seconds": float(second), "metrics": {"nvs/psnr": value}}
            for point, (second, value) in zip(result["trail"][last], scores, strict=True)
        ]
        trail = {**result["trail"], last: points}
        return {**result, "trail": trail, "seconds": dict.fromkeys(result["seconds"], 0.0)}

    return scored


def test_runs_of_another_kind_are_not_compared(finished: Path, baseline: Path) -> None:
    content = json.loads(baseline.read_text()) | {"preset": "paper"}
    with pytest.raises(DataError, match="preset smoke against paper"):
        compare(Store(finished), read_sweep(finished), content)


def test_a_baseline_is_refused_while_cells_are_missing(tmp_path: Path) -> None:
    run = finished_sweep(tmp_path, seeds=3)
    sorted((run / "cells").glob("*.json"))[0].unlink()
    with pytest.raises(DataError, match="1 of 15 cells are not finished"):
        baseline_of(Store(run), read_sweep(run))


@pytest.mark.parametrize("content", ["", "[]", '{"schema": "radiogs-bench/baseline/0"}'])
def test_a_file_that_is_no_baseline_is_an_error(
    content: str, finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "baseline.json"
    file.write_text(content)
    assert main(["gate", str(finished), "--baseline", str(file)]) == 3
    assert "--update" in capsys.readouterr().err
