"""Suite ``hard-training``: changes of metrics under conditions that should change nothing are named and bounded."""

from pathlib import Path
from typing import Any

import pytest

from radiogs_bench.results.invariance import SAME, TOLERANCES, invariance_kept
from radiogs_bench.runs.sweep import CellRef
from radiogs_bench.store.folder import Store
from radiogs_bench.suites.own import HARD_TRAINING
from radiogs_core.errors import NumericalFailure
from radiogs_datasets.hard_scenes import BASE, CONDITIONS


def cells_with(values: dict[str, list[float | None]], monkeypatch: pytest.MonkeyPatch) -> list[CellRef]:
    """Cells of one row by scene and seed, whose results have these PSNRs of new views."""
    results: dict[str, Any] = {
        f"{scene} {seed}": {"metrics": {"nvs/psnr": {"value": value}}}
        for scene, each in values.items()
        for seed, value in enumerate(each)
    }
    monkeypatch.setattr(Store, "result", lambda self, key: results.get(key))
    keys = [*results, "unfinished 0"]
    return [CellRef(row="ours", scene=key.split()[0], seed=int(key.split()[1]), key=key, stages=[]) for key in keys]


def test_the_suite_has_the_miniature_and_every_condition() -> None:
    assert HARD_TRAINING.scenes == (BASE, *CONDITIONS)
    assert set(SAME) == {"hard-scale-1e-4", "hard-scale-1e4", "hard-distance-1e3"}


def test_a_change_is_the_mean_over_shared_seeds_and_other_conditions_may_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cells = cells_with({BASE: [30.0, 31.0], SAME[0]: [31.5, 30.1, 99.0], "hard-black": [3.0, 3.0]}, monkeypatch)
    said = invariance_kept(Store(tmp_path), cells)
    assert f"ours, {SAME[0]}, nvs/psnr +0.30 dB." in said
    assert "hard-black" not in said


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_change_beyond_its_tolerance_fails_with_the_condition_and_the_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sign: int
) -> None:
    moved = 30.0 + sign * (TOLERANCES["nvs/psnr"] + 0.01)
    cells = cells_with({BASE: [30.0], SAME[1]: [moved], SAME[2]: [30.0]}, monkeypatch)
    with pytest.raises(NumericalFailure, match="1 of 2 metrics change") as caught:
        invariance_kept(Store(tmp_path), cells)
    assert f"ours, {SAME[1]}, nvs/psnr {moved - 30:+.2f} dB." in caught.value.why


def test_without_the_miniature_itself_nothing_is_claimed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cells = cells_with({SAME[0]: [30.0], BASE: [None]}, monkeypatch)
    assert "Invariance was not measured" in invariance_kept(Store(tmp_path), cells)


def test_guards_are_counted_and_neither_ranked_nor_better_or_worse() -> None:
    from radiogs_bench.results.summary import column_summary
    from radiogs_bench.suites.suite import Metric
    from radiogs_reports.analysis.comparisons import ranks, to_reference
    from radiogs_reports.statistics import Origin

    column = column_summary(Metric("guards", "fired"))
    assert column["direction"] == "none"
    samples = {
        row: {Origin("s", seed, ""): first + seed for seed in range(4)} for row, first in (("a", 1.0), ("b", 9.0))
    }
    assert ranks(samples, "none") == {}
    assert ranks(samples, "down") == {"a": 1, "b": 2}
    assert to_reference(samples, "a", "none")["b"].verdict is None
