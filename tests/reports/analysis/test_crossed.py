"""Pairs of rows that differ in one setting: which are found, what they are worth, and where that is written."""

import copy

import numpy as np
import pytest

from made_up_run import cell, in_every_form, run, summary, t_interval
from radiogs_reports.analysis.crossed import crossed_of, crossed_report
from radiogs_reports.summary import Summary

SCENES = ("one", "two", "three")
ROWS = {
    "held": {"weight": 0.2, "light": {"rate": 0.0}},
    "held-without": {"weight": 0.0, "light": {"rate": 0.0}},
    "learnt": {"weight": 0.2, "light": {"rate": 0.01}},
    "learnt-without": {"weight": 0.0, "light": {"rate": 0.01}},
}
WORTH = {"held": 30.0, "held-without": 30.1, "learnt": 29.0, "learnt-without": 27.0}


def made_up() -> Summary:
    """Four rows on three scenes: L_rad is worth 2 dB where the light is learnt, and nothing where it is held."""
    generator = np.random.default_rng(5)
    made = summary()
    made["columns"], made["scenes"], made["seeds"], made["reference"] = made["columns"][:1], list(SCENES), [0], "held"
    made["paper"], made["sheet"], made["runs"] = [], [], []
    made["rows"] = [{"key": row, "latex": row, "text": f"row {row}", "seconds": 1.0} for row in ROWS]
    for row, variant in ROWS.items():
        for scene, noise in zip(SCENES, generator.normal(size=3), strict=True):
            each = run(row, scene, 0, f"{row}{scene}", {"nvs/psnr": WORTH[row] + 0.2 * noise})
            each["made_from"] = {"method": "radiogs", "variant": variant, "budget": {"steps": 3}}
            made["runs"].append(each)
    made["cells"] = {row: {"nvs/psnr": cell(30.0)} for row in ROWS}
    return made


def test_each_setting_is_found_with_all_pairs_that_differ_in_it_alone() -> None:
    weight, rate = sorted(crossed_of(made_up()), key=lambda each: each.setting, reverse=True)
    assert (weight.setting, weight.values) == ("weight", (0.2, 0.0))
    assert weight.pairs == [("held", "held-without"), ("learnt", "learnt-without")]
    assert (rate.setting, rate.values) == ("light.rate", (0.0, 0.01))
    assert rate.pairs == [("held", "learnt"), ("held-without", "learnt-without")]


def test_a_pairs_difference_is_the_paired_one_and_only_what_is_certain_is_resolved() -> None:
    made = made_up()
    report = crossed_report(made)
    assert report is not None
    values = {
        row: np.array([each["metrics"]["nvs/psnr"] for each in made["runs"] if each["row"] == row]) for row in ROWS
    }
    for one, other in (("held", "held-without"), ("learnt", "learnt-without")):
        (found,) = [each for each in report.records if (each["row"], each["instead_of"]) == (one, other)]
        assert found["difference"] == pytest.approx(float((values[one] - values[other]).mean()))
        assert (found["difference_low"], found["difference_high"]) == pytest.approx(
            t_interval(values[one] - values[other])
        )
    (sentence,) = [each for each in report.sentences if each.startswith("weight = 0.2 instead of 0.0")]
    assert sentence.endswith("in 2 pairs of rows, resolved in 1.")
    made["doubts"] = [{"column": "nvs/psnr", "rows": ["learnt"], "text": "not determined"}]
    report = crossed_report(made)
    assert report is not None
    assert sum("resolved in 0" in each for each in report.sentences if each.startswith("weight")) == 1


def test_every_form_holds_every_pair() -> None:
    records = in_every_form(made_up(), "crossed")
    assert set(zip(records["row"], records["instead_of"], strict=True)) == {
        ("held", "held-without"), ("learnt", "learnt-without"), ("held", "learnt"), ("held-without", "learnt-without"),
    }  # fmt: skip


def test_rows_of_other_budgets_and_single_pairs_are_left_out() -> None:
    longer = copy.deepcopy(made_up())
    for each in longer["runs"]:
        if each["row"].startswith("learnt"):
            each["made_from"] = {**each["made_from"], "budget": {"steps": 6}}
    assert [each.setting for each in crossed_of(longer)] == ["weight"]
    single = made_up()
    single["rows"] = single["rows"][:2]
    assert crossed_report(single) is None
