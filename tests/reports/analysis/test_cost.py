"""The cost report: its sentences and tables against values computed from the runs by other means."""

import copy
import re
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from made_up_run import cell, in_every_form, run, summary, t_interval
from radiogs_reports.analysis.cost import cost_report
from radiogs_reports.analysis.cost_knobs import knobs
from radiogs_reports.analysis.cost_progress import equal_quality, seconds_to, value_at
from radiogs_reports.analysis.pareto import points
from radiogs_reports.analysis.report import Item, Report
from radiogs_reports.analysis.samples import values_of
from radiogs_reports.analysis.settling import ScoredPoint
from radiogs_reports.figures.convergence import convergence_figures, mean_curve
from radiogs_reports.figures.cost import knob_figures
from radiogs_reports.run_folder import texts
from radiogs_reports.summary import Summary
from radiogs_reports.wording import plus_minus, signed
from radiogs_reports.write.analyses import findings_latex

BUDGET = {"name": "tiny", "inverse_iterations": 800, "incident_samples": 32, "consistency_surfels": 256}
ROWS: dict[str, dict[str, int]] = {
    "reference": {},
    "iterations-half": {"inverse_iterations": 400},
    "ns-half": {"incident_samples": 16},
    "ns-double": {"incident_samples": 64},
    "draft": {"inverse_iterations": 400, "incident_samples": 16},
}
SEEDS = (0, 1, 2)


def made_up(seeds: tuple[int, ...] = SEEDS) -> Summary:
    """Five rows on one scene; metrics, seconds and rays are random, so that nothing agrees by chance."""
    generator = np.random.default_rng(5)
    made = summary()
    made["columns"], made["reference"], made["paper"], made["sheet"] = made["columns"][:2], "reference", [], []
    made["rows"] = [{"key": row, "latex": row, "text": row, "seconds": 1.0} for row in ROWS]
    made["runs"] = []
    for row, changes in ROWS.items():
        for seed in SEEDS:
            quality, error, seconds, rays = generator.random(4)
            each = run(row, "my_scene", seed, f"{row}{seed}", {"nvs/psnr": 30 + quality, "normal/mae": 7 + error})
            each["seconds"] = {"initialise": 4.0, "invert": 1 + 5 * seconds, "evaluate": 77.0}
            each["work"] = {"initialise": {}, "invert": {"rays": 1000 + int(5000 * rays)}, "evaluate": {"rays": 9}}
            each["made_from"] = {"variant": {"detach": "none"}, "budget": {**BUDGET, **changes, "name": row}}
            if seed in seeds:
                made["runs"].append(each)
    made["seeds"] = list(seeds)
    made["cells"] = {
        row: {key: cell(float(np.mean(list(values_of(made, row, key).values())))) for key in ("nvs/psnr", "normal/mae")}
        for row in ROWS
    }
    return made


def half_width(values: Any) -> float:
    low, high = t_interval(values)
    return (high - low) / 2


def frame(made: Summary) -> pd.DataFrame:
    """The runs as a table: row, seed, psnr, mae, seconds, rays."""
    return pd.DataFrame(
        {
            "row": each["row"], "seed": each["seed"], "psnr": each["metrics"]["nvs/psnr"],
            "mae": each["metrics"]["normal/mae"], "seconds": each["seconds"]["initialise"] + each["seconds"]["invert"],
            "rays": each["work"]["invert"]["rays"],
        }
        for each in made["runs"]
    ).set_index(["row", "seed"])  # fmt: skip


def report_of(made: Summary) -> Report:
    report = cost_report(made)
    assert report is not None
    return report


@pytest.mark.parametrize(
    ("low", "high", "begins"),
    [
        ("iterations-half", "reference", "iterations of stage 2, 400 → 800: "),
        ("ns-half", "reference", "rays a surfel, N_s, 16 → 32: "),
        ("reference", "ns-double", "rays a surfel, N_s, 32 → 64: "),
    ],
)
def test_each_sentence_agrees_with_the_runs(low: str, high: str, begins: str) -> None:
    made = made_up()
    (sentence,) = [each for each in report_of(made).sentences if each.startswith(begins)]
    table = frame(made)
    change, before, after = table.loc[high] - table.loc[low], table.loc[low], table.loc[high]
    numbers = [float(each) for each in re.findall(r"[-+]?\d+\.\d+", sentence.removeprefix(begins))]
    expected = [change.psnr.mean(), half_width(change.psnr), change.mae.mean(), half_width(change.mae)]
    expected += [stats.gmean(after.seconds / before.seconds), stats.gmean(after.rays / before.rays)]
    assert numbers == pytest.approx(expected, abs=0.00501)
    assert "NVS PSNR" in sentence
    assert " dB, Normal MAE" in sentence
    assert sentence.endswith("times the rays.")


def test_a_doubling_is_the_slope_of_a_line_through_each_seed() -> None:
    made = made_up()
    (sentence,) = [each for each in report_of(made).sentences if each.startswith("Each doubling of rays a surfel")]
    table = frame(made).loc[["ns-half", "reference", "ns-double"]]
    slopes = [np.polyfit([4, 5, 6], table.xs(seed, level="seed").psnr, 1)[0] for seed in SEEDS]
    times = [np.polyfit([4, 5, 6], np.log2(table.xs(seed, level="seed").seconds), 1)[0] for seed in SEEDS]
    numbers = [float(each) for each in re.findall(r"[-+]?\d+\.\d+", sentence)]
    assert numbers[:2] == pytest.approx([np.mean(slopes), half_width(slopes)], abs=0.00501)
    assert numbers[-1] == pytest.approx(2 ** np.mean(times), abs=0.00501)


def test_a_single_seed_gives_no_interval() -> None:
    sentences = report_of(made_up((0,))).sentences
    assert sentences
    assert not any("±" in each for each in sentences)


def test_the_gain_of_the_second_half_agrees_with_the_trails() -> None:
    """Made-up trails were scored after 1, 2, 4 and 8 steps of 0.25 s, a decibel better each time, after 4 s."""
    (sentence,) = [each for each in report_of(made_up()).sentences if each.startswith("The second half")]
    assert "NVS PSNR +1.00 ± 0.00 dB, Normal MAE -1.00 ± 0.00 degrees" in sentence
    assert f"for {100 * 1.0 / 6.0:.0f} % of the training time" in sentence


def test_every_form_has_the_values_and_efficiency_is_one_over_error_times_seconds() -> None:
    made = made_up()
    made["rows"][0]["text"] = "100 % & more_"
    stored = in_every_form(made, "cost").set_index(["what", "row"])
    table = frame(made)
    for row in ROWS:
        mine, base = table.loc[row], table.loc["reference"]
        error, base_error = 10 ** (-mine.psnr / 10), 10 ** (-base.psnr / 10)
        expected = stats.gmean((base_error * base.seconds) / (error * mine.seconds))
        assert stored.loc[("efficiency", row)].value == pytest.approx(expected)


def test_quality_at_a_time_and_time_to_quality_are_inverse() -> None:
    column = made_up()["columns"][0]
    curve = [ScoredPoint(2.0, 20.0), ScoredPoint(3.0, 24.0), ScoredPoint(5.0, 25.0)]
    seconds = np.linspace(2, 5, 13)
    expected = np.interp(seconds, [2, 3, 5], [20, 24, 25])
    assert [value_at(curve, each) for each in seconds] == pytest.approx(expected)
    assert [seconds_to(curve, each, column) for each in expected] == pytest.approx(seconds)
    assert value_at(curve, 1.9) is None
    assert value_at(curve, 99.0) == 25.0
    assert seconds_to(curve, 25.1, column) is None
    assert seconds_to([ScoredPoint(1, 9.0), ScoredPoint(2, 7.0)], 8.0, made_up()["columns"][1]) == pytest.approx(1.5)


def test_every_scene_has_its_own_targets_and_the_reference_reaches_them() -> None:
    """A second scene lies 10 dB higher, its training is three times slower; one row lies 0.6 dB lower throughout."""
    made = made_up()
    for each in list(made["runs"]):
        slower = copy.deepcopy(each)
        slower["scene"] = "other"
        for point in slower["trail"]["invert"]:
            point["seconds"] *= 3
            point["metrics"]["nvs/psnr"] += 10
        made["runs"].append(slower)
    for each in made["runs"]:
        for point in each["trail"]["invert"]:
            point["metrics"]["nvs/psnr"] -= 0.6 if each["row"] == "draft" else 0.0
    found = [line for line in equal_quality(made).rows if line[0].text == "NVS PSNR"]
    # 26, 27, 28, 29 dB after 1, 2, 4, 8 quarters of a second; stage 1 takes 4 s.
    for each, share in zip(found, (0.5, 0.75, 0.9, 1.0), strict=True):
        assert each[2].value == pytest.approx(31 + 3 * share)
        quarters = np.interp(3 * share, [0, 1, 2, 3], [1, 2, 4, 8])
        assert each[5].value == pytest.approx(4 + 0.25 * quarters * (1 + 3) / 2)
    assert [each[6].value for each in found] == [5, 5, 4, 4]  # 26 - 0.6 + 3 dB are 80 % of the way


def test_a_value_that_rounds_to_zero_has_no_sign_and_half_an_interval_does_not_round_to_zero() -> None:
    shown = [signed(value, 2) for value in (-0.004, 0.004, 0.0, -0.006, 0.006)]
    assert shown == ["0.00", "0.00", "0.00", "-0.01", "+0.01"]
    assert plus_minus(0.001, 0.00043, 3) == "+0.0010 ± 0.0004"
    assert plus_minus(0.001, 0.0000043, 3) == "+0.00100 ± 4.3e-06"
    assert plus_minus(0.5, 1e-16, 2) == "+0.50 ± 0.00", "rounding in floating point"


def test_the_pareto_front_of_the_tables_holds_the_rows_that_are_better_than_cheaper_ones() -> None:
    made = made_up()
    for each in made["runs"]:
        each["metrics"]["nvs/psnr"] += 100.0 * (each["row"] == "draft")
        each["seconds"]["invert"] += 300.0 * (each["row"] == "draft")
    table = frame(made).reset_index().pivot(index="seed", columns="row")
    (grid,) = [each for each in report_of(made).grids if each.name == "fronts"]
    named = {row[2].text for row in grid.rows if (row[0].text, row[1].text) == ("NVS PSNR", "seconds of training")}
    front: list[str] = []
    for row in table.seconds.mean().sort_values().index:
        gains = [stats.ttest_rel(table.psnr[row], table.psnr[other]) for other in front]
        spent = [stats.ttest_rel(table.seconds[row], table.seconds[other]) for other in front]
        if all(each.statistic > 0 and each.pvalue < 0.05 for each in (*gains, *spent)):
            front.append(row)
    assert named == {*front}
    assert len(front) == 2, "the cheapest, and the one that is better by far"
    assert len(points(made, made["columns"][0], "seconds")) == len(ROWS)


@pytest.mark.parametrize("part", ["variant", "settings"])
def test_rows_that_differ_in_two_knobs_or_in_something_else_belong_to_none(part: str) -> None:
    made = made_up()
    assert {setting.row for knob in knobs(made) for setting in knob.settings} == set(ROWS) - {"draft"}
    for each in made["runs"]:
        if each["row"] != "reference":
            each["made_from"][part] = {"detach": each["row"]}
    assert cost_report(made) is None
    assert knob_figures(made) == []
    assert not any("cost" in name for name in texts(made))


def test_fields_that_belong_together_are_one_knob_where_one_factor_multiplies_both() -> None:
    made = made_up()
    for each in made["runs"]:
        first, second = {"ns-half": (32, 16), "ns-double": (128, 64), "draft": (32, 64)}.get(each["row"], (64, 32))
        budget = {"name": each["row"], "relight_hemisphere_samples": first, "relight_light_samples": second}
        more = {"inverse_iterations": 400} if each["row"] == "iterations-half" else {}  # with all three: no knob
        budget |= {"relight_hemisphere_samples": 32, "relight_light_samples": 16} if more else {}
        each["made_from"]["budget"] = BUDGET | budget | more
    (knob,) = knobs(made)
    assert knob.text == "rays of a relit surfel, of each kind"
    assert knob.settings == ((32, "ns-half"), (64, "reference"), (128, "ns-double"))


def test_a_long_grid_goes_on_over_the_page_and_loses_no_row() -> None:
    made = made_up()
    report = report_of(made)
    slopes, *_ = report.grids
    long = slopes._replace(rows=[[Item(f"line {place}", place), *slopes.rows[0][1:]] for place in range(70)])
    written = findings_latex(made, "The cost", report._replace(grids=[long]))
    tables = written.split(r"\begin{table}")[1:]
    assert [re.findall(r"line (\d+) ", table) for table in tables] == [
        [str(place) for place in places] for places in (range(32), range(32, 64), range(64, 70))
    ]
    assert [r"\label{grid:doublings}" in table for table in tables] == [True, False, False]


def test_figures_of_the_knobs_and_of_convergence_hold_the_means() -> None:
    made = made_up()
    assert [each.name for each in knob_figures(made)] == ["cost", "cost-in-rays", "cost-doublings"]
    losses, metrics = convergence_figures(made)
    (line, *_) = losses.figure.axes[2].get_lines()
    assert line.get_xydata() == pytest.approx(np.array([[1, 0.5], [2, 0.25], [4, 0.125], [8, 0.0625]]))
    (line, *_) = metrics.figure.axes[0].get_lines()
    assert line.get_ydata() == pytest.approx([26, 27, 28, 29])
    assert mean_curve({}, lambda point: 1.0) == []


def test_rows_that_share_a_training_are_one_line_and_others_are_not() -> None:
    made = made_up()
    losses, _ = convergence_figures(made)
    assert [text.get_text() for text in losses.figure.legends[0].get_texts()] == ["all rows"]
    for each in made["runs"]:
        if each["row"] in ("ns-half", "draft"):
            each["trail"]["invert"][0]["losses"]["consistency"] = 9.0
    losses, _ = convergence_figures(made)
    assert [text.get_text() for text in losses.figure.legends[0].get_texts()] == [
        "reference; iterations-half; ns-double", "ns-half; draft",
    ]  # fmt: skip


def test_bias_and_variance_are_shares_of_the_error() -> None:
    made = made_up()
    assert "Bias and variance" not in [grid.title for grid in report_of(made).grids]
    made["error_parts"] = {"reference": {"relit": {"error": 1e-3, "variance": 2.5e-4, "scenes": 2}}}
    report = report_of(made)
    (grid,) = [each for each in report.grids if each.name == "error-parts"]
    assert grid.heads == ["row", "relit views"]
    assert [item.text for item in grid.rows[0]] == ["reference", "25.0 % of 30.00 dB"]
    assert any("relit views 25 %" in sentence for sentence in report.sentences)
