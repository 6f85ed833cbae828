"""A run beside another one: values and settings that differ, and cells that are left out."""

import copy
from typing import Any

import numpy as np
import pytest
from scipy import stats

from made_up_run import cell, in_every_form, run, summary
from radiogs_reports.analysis.beside import Beside, beside_report, compared_values, other_run
from radiogs_reports.analysis.report import Report
from radiogs_reports.run_folder import texts
from radiogs_reports.summary import Summary

SCENES = ("one", "two", "three", "four")
GAINS = {"ours": 0.5, "no-rad": 0.02, "noisy": -0.3}
"""By row: a gain that is resolved, one that is not, and a loss among noise."""


def made_up(later: bool) -> Summary:
    """Three rows on four scenes; in the later run they have gained, by chance more or less."""
    generator = np.random.default_rng(8)
    made = summary()
    made["columns"], made["scenes"], made["seeds"] = made["columns"][:1], list(SCENES), [0]
    made["paper"], made["sheet"], made["runs"] = [], [], []
    made["rows"] = [{"key": row, "latex": row, "text": f"row {row}", "seconds": 1.0} for row in GAINS]
    for row, gain in GAINS.items():
        for scene in SCENES:
            level, noise = generator.normal(30, 3), generator.normal(0, 0.05 if row == "ours" else 0.4)
            each = run(row, scene, 0, f"{row}{scene}", {"nvs/psnr": level + later * (gain + noise)})
            weight = 0.1 if later and row == "ours" else 0.2
            each["made_from"] = {"checksum": scene, "variant": {"weight": weight}, "budget": {"steps": 3}}
            made["runs"].append(each)
    made["cells"] = {row: {"nvs/psnr": cell(30.0)} for row in GAINS}
    return made


def beside(now: Summary, before: Summary) -> Report:
    now["beside"] = other_run(before, "before", {"Commit": "abc"})
    found = beside_report(now)
    assert found is not None
    return found


def by_row(now: Summary, before: Summary) -> dict[str, Beside]:
    return {each.row: each for each in compared_values(now, other_run(before, "before", {}), now["columns"][-1])}


def values(made: Summary, row: str) -> list[Any]:
    return [each["metrics"]["nvs/psnr"] for each in made["runs"] if each["row"] == row]


def test_differences_are_paired_t_tests_with_holms_correction_over_the_rows() -> None:
    now, before = made_up(later=True), made_up(later=False)
    found = by_row(now, before)
    tests = {row: stats.ttest_rel(values(now, row), values(before, row)) for row in GAINS}
    ordered = sorted(GAINS, key=lambda row: tests[row].pvalue)
    highest = 0.0
    for place, row in enumerate(ordered):
        highest = max(highest, (len(GAINS) - place) * tests[row].pvalue)
        interval = tests[row].confidence_interval(0.95)
        difference = found[row].difference
        assert (difference.low, difference.high) == pytest.approx((interval.low, interval.high))
        assert found[row].verdict == ("better" if highest < 0.05 else None)
    assert {row: each.verdict for row, each in found.items()} == {"ours": "better", "no-rad": None, "noisy": None}
    backwards = by_row(made_up(later=False), made_up(later=True))
    assert backwards["ours"].verdict == "worse"


def test_sentences_name_gains_other_settings_and_missing_counterparts() -> None:
    now, before = made_up(later=True), made_up(later=False)
    before["runs"] = [each for each in before["runs"] if (each["row"], each["scene"]) != ("noisy", "one")]
    for each in before["runs"]:
        if each["scene"] == "four":
            each["made_from"]["checksum"] = "other files"
    found = beside(now, before)
    text = "\n".join(found.sentences)
    assert "Other run: before (commit abc)." in text
    assert "row ours: better: NVS PSNR +0." in text
    assert "row ours, settings: variant.weight 0.2 there, 0.1 here." in text
    assert "row noisy, settings" not in text
    assert "11 cells of both; 1 of this run alone, 0 of the other alone." in text
    assert "Not compared, because its files or how it was opened differ: four." in text
    assert {row: each.difference.values for row, each in by_row(now, before).items()} == {
        "ours": 3,
        "no-rad": 3,
        "noisy": 2,
    }


def test_equal_runs_are_called_equal_and_a_run_without_another_has_no_comparison() -> None:
    now = made_up(later=False)
    assert beside_report(now) is None
    assert "tables/beside.md" not in texts(now)
    before = copy.deepcopy(now)
    found = beside(now, before)
    assert all(each.equal and each.verdict is None for each in by_row(now, before).values())
    assert "row ours: equal to the last bit: NVS PSNR." in found.sentences


def test_every_form_has_the_comparison() -> None:
    now = made_up(later=True)
    beside(now, made_up(later=False))
    records = in_every_form(now, "beside")
    assert list(records)[:6] == ["row", "metric", "there", "there_low", "there_high", "here"]
    assert len(records) == len(GAINS)
