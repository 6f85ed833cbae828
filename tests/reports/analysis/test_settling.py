"""Time to quality: when a metric stays near its final value, in the report, on the page and in files."""

import numpy as np
import pytest

from made_up_run import in_every_form, summary
from radiogs_reports.analysis.settling import ScoredPoint, band_of, curve, settled_after, settling, settling_report
from radiogs_reports.summary import Summary


def scored() -> Summary:
    """A made-up run in which every finished cell of the first row was scored after 1, 2, 4 and 8 of its seconds."""
    made = summary()
    row = made["rows"][0]["key"]
    for place, each in enumerate(run for run in made["runs"] if run["row"] == row and run["metrics"]):
        last = each["stages"][-1]["name"]
        each["seconds"] = dict.fromkeys(each["seconds"], 10.0) | {last: 8.0}
        values = (20.0, 29.0, 29.8 + place, 30.0 + place)
        each["trail"][last] = [
            {"iteration": step, "seconds": float(step), "losses": {}, "metrics": {"nvs/psnr": value}}
            for step, value in zip((1, 2, 4, 8), values, strict=True)
        ]
    made["settling"] = settling(made)
    return made


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([20, 25, 29.8, 30], 2 + 2 * (29.5 - 25) / 4.8),
        ([20, 30.4, 29, 30], 4 + 4 * 0.5),  # it was near once before, and left again
        ([29.6, 29.9, 30.4, 30], 1),  # near at the first scored point
        ([20, 25, 27, 30], 4 + 4 * 2.5 / 3),
        ([40, 35, 30.2, 30], 2 + 2 * (35 - 30.5) / 4.8),  # from above
    ],
)
def test_a_value_is_settled_once_it_stays_within_the_band(values: list[float], expected: float) -> None:
    points = [ScoredPoint(seconds, float(value)) for seconds, value in zip((1.0, 2.0, 4.0, 8.0), values, strict=True)]
    found = settled_after(points, 0.5)
    assert found == pytest.approx(expected)
    grid = np.linspace(1, 8, 70_001)
    near = (
        np.abs(np.interp(grid, [point.seconds for point in points], [point.value for point in points]) - values[-1])
        <= 0.5 + 1e-9
    )
    assert grid[len(near) - np.argmin(near[::-1]) if not near.all() else 0] == pytest.approx(expected, abs=1e-3)


def test_each_metric_has_a_band_of_its_own_and_one_point_settles_nothing() -> None:
    assert [band_of("psnr", "dB", 30), band_of("mae", "deg", 4), band_of("ssim", "", 0.9)] == [0.5, 0.5, 0.01]
    assert band_of("mse", "", -2.0) == pytest.approx(0.1)
    assert settled_after([ScoredPoint(1.0, 2.0)], 0.5) is None


def test_earlier_stages_count_and_evaluation_does_not() -> None:
    made = scored()
    run = next(each for each in made["runs"] if each["row"] == made["rows"][0]["key"] and each["metrics"])
    before = 10.0 * (len(run["stages"]) - 1)
    assert [point.seconds for point in curve(run, "nvs/psnr")] == [before + each for each in (1, 2, 4, 8)]


def test_every_form_has_the_same_seconds() -> None:
    made = scored()
    settled = made["settling"][made["rows"][0]["key"]]["nvs/psnr"]
    report = settling_report(made)
    assert report is not None
    assert report.grids[0].rows[0][1].text.startswith(f"{settled['seconds']:.1f}")
    assert f"{settled['seconds']:.1f} s" in report.sentences[0]
    table = in_every_form(made, "settling")
    assert table.seconds[0] == pytest.approx(settled["seconds"])
    assert table["count"][0] == settled["count"]


def test_a_run_without_scores_during_training_has_no_report() -> None:
    made = summary()
    for each in made["runs"]:
        each["trail"] = {}
    made["settling"] = settling(made)
    assert made["settling"] == {}
    assert settling_report(made) is None
