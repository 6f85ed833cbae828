"""Chains of rows: which runs are one, what a step is worth, and what is drawn."""

from itertools import pairwise

import numpy as np
import pytest

from made_up_run import cell, in_every_form, run, summary
from radiogs_reports.analysis.chain import chain_of, chain_report, worth_of
from radiogs_reports.figures.chain import chain_figures
from radiogs_reports.summary import Summary

STEPS = ("printed", "start", "light", "rays")
CHANGES = ({}, {"start": {"points": "swept"}}, {"light": "sought"}, {"rays": 2, "masking": "schlick"})
WORTH = (0.0, 1.0, -3.0, 0.5)
SCENES = ("one", "two", "three")


def made_up() -> Summary:
    """Four rows on three scenes: a step is worth WORTH everywhere, but the last by chance more or less."""
    generator = np.random.default_rng(3)
    made = summary()
    made["columns"], made["scenes"], made["seeds"], made["reference"] = made["columns"][:1], list(SCENES), [0], STEPS[0]
    made["paper"], made["sheet"], made["runs"] = [], [], []
    made["rows"] = [{"key": row, "latex": row, "text": f"row {row}", "seconds": 1.0} for row in STEPS]
    variant: dict[str, object] = {"start": {"points": "hull"}, "light": "constant", "rays": 1, "masking": "height"}
    quality = dict.fromkeys(SCENES, 30.0)
    for row, changes, worth in zip(STEPS, CHANGES, WORTH, strict=True):
        variant = {**variant, **changes}
        for scene, noise in zip(SCENES, generator.normal(size=3), strict=True):
            quality[scene] += worth + (3 if row == "rays" else 0.01) * noise * (row != "printed")
            each = run(row, scene, 0, f"{row}{scene}", {"nvs/psnr": quality[scene]})
            each["seconds"] = {"initialise": 4.0, "invert": 10.0 + STEPS.index(row), "evaluate": 77.0}
            each["made_from"] = {"method": "radiogs", "variant": variant, "budget": {"steps": 3}}
            made["runs"].append(each)
    made["cells"] = {row: {"nvs/psnr": cell(30.0)} for row in STEPS}
    return made


def test_a_step_is_the_paired_difference_to_the_row_before_and_all_add_up() -> None:
    made = made_up()
    report = chain_report(made)
    assert report is not None
    psnr, seconds = worth_of(made, [*STEPS])
    by_row = {
        row: np.array([each["metrics"]["nvs/psnr"] for each in made["runs"] if each["row"] == row]) for row in STEPS
    }
    for before, row in pairwise(STEPS):
        step = psnr.steps[row]
        assert step is not None
        assert step.mean == pytest.approx(float((by_row[row] - by_row[before]).mean()))
    assert psnr.first is not None
    assert psnr.last is not None
    total = sum(step.mean for step in psnr.steps.values() if step is not None)
    assert psnr.last.mean == pytest.approx(psnr.first.mean + total)
    assert [step.mean for step in seconds.steps.values() if step is not None] == pytest.approx([1, 1, 1])
    (sentence, _) = report.sentences
    assert "resolved steps: row start +1.0" in sentence
    assert "row light -3.0" in sentence
    assert "row rays" not in sentence


def resolved_in(made: Summary) -> set[str]:
    return set(worth_of(made, [*STEPS])[0].resolved)


def test_a_step_is_resolved_by_holms_correction_and_where_no_footnote_concerns_it() -> None:
    """Every step alone has p = 0.03: three such are not resolved, and one beside two that are certain is."""
    made = made_up()
    assert resolved_in(made) == {"start", "light"}
    made["doubts"] = [{"column": "nvs/psnr", "rows": ["light"], "text": "not determined"}]
    assert resolved_in(made) == {"start"}
    made = made_up()
    for each in made["runs"]:
        place = STEPS.index(each["row"])
        each["metrics"]["nvs/psnr"] = 30 + place * (1 + 0.309 * (SCENES.index(each["scene"]) - 1))
    assert resolved_in(made) == set()
    for each in made["runs"]:
        if each["row"] in ("light", "rays"):
            each["metrics"]["nvs/psnr"] += 5 * (STEPS.index(each["row"]) - 1)
    assert resolved_in(made) == {"start", "light", "rays"}


def test_the_table_and_the_figure_hold_every_step() -> None:
    made = made_up()
    records = in_every_form(made, "chain")
    steps = records[records["metric"] == "nvs/psnr"].set_index("row")
    assert list(steps["after"]) == list(STEPS[:-1])
    (sketch,) = chain_figures(made)
    axes = sketch.figure.axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == [
        "row printed", "+ row start", "+ row light", "+ row rays", "all together",
    ]  # fmt: skip
    bars = {round(bar.get_y() + bar.get_height() / 2): bar for bar in axes.patches}
    for place, row in enumerate(STEPS[1:], start=1):
        assert bars[place].get_width() == pytest.approx(steps.loc[row, "difference"])
        ends = bars[place].get_x() + bars[place].get_width()
        assert bars[place + 1].get_x() == pytest.approx(ends) or place == len(STEPS) - 1
    alphas = [bars[place].get_alpha() for place in (1, 2, 3)]
    assert alphas[0] == alphas[1] == 1.0
    assert alphas[2] < 1.0


def test_rows_that_change_a_field_twice_or_a_budget_are_no_chain() -> None:
    assert chain_of(made_up()) == list(STEPS)
    twice = made_up()
    for each in twice["runs"]:
        if each["row"] == "rays":
            each["made_from"]["variant"] = {**each["made_from"]["variant"], "light": "constant"}
    assert chain_of(twice) is None
    longer = made_up()
    for each in longer["runs"]:
        if each["row"] == "rays":
            each["made_from"]["budget"] = {"steps": 6}
    assert chain_of(longer) is None
    short = made_up()
    short["rows"] = short["rows"][:3]
    assert chain_of(short) is None
