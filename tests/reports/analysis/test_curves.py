"""Curves over one number of the budget, and of what a setting is worth: what is drawn, and which runs have any."""

from typing import Any

import numpy as np
import pytest

from made_up_run import run, summary
from radiogs_reports.figures.curves import curve_figures
from radiogs_reports.figures.effect_curves import effect_curve_figures
from radiogs_reports.summary import Summary

SETTINGS = (100, 300, 1000)
SCENES = ("one", "two")


def made_up(variants: dict[str, dict[str, Any]], settings: tuple[int, ...] = SETTINGS) -> Summary:
    """Rows of each variant at each setting, on two scenes with two seeds: 10 v + log10 of the setting + the seed,
    and 5 more on the second scene, 8 at its highest setting."""
    made = summary()
    made["columns"], made["scenes"], made["seeds"] = made["columns"][:2], list(SCENES), [0, 1]
    made["paper"], made["sheet"], made["rows"], made["runs"] = [], [], [], []
    for place, (name, variant) in enumerate(variants.items()):
        for setting in settings:
            row = f"{name}-{setting}"
            made["rows"].append({"key": row, "latex": row, "text": f"{name}, {setting} steps", "seconds": 1.0})
            for scene in SCENES:
                for seed in (0, 1):
                    value = 10 * place + np.log10(setting) + seed + SCENES.index(scene) * (8 if setting == 1000 else 5)
                    each = run(row, scene, seed, f"{row}{scene}{seed}", {"nvs/psnr": value, "normal/mae": -value})
                    budget = {"name": row, "inverse_iterations": setting, "incident_samples": 32}
                    each["made_from"] = {"method": "radiogs", "variant": variant, "budget": budget}
                    made["runs"].append(each)
    return made


def test_one_series_is_a_line_for_each_scene_with_its_seeds_as_a_band() -> None:
    (sketch,) = curve_figures(made_up({"ours": {"detach": "none"}}))
    upward, downward = sketch.figure.axes
    for number, line in enumerate(upward.get_lines()):
        expected = [(each, np.log10(each) - 2 + 3 * number * (each == 1000)) for each in SETTINGS]
        assert line.get_xydata() == pytest.approx(np.array(expected))
    assert [text.get_text() for text in sketch.figure.legends[0].get_texts()] == list(SCENES)
    low, high = (band.get_paths()[0].vertices[:, 1] for band in upward.collections)
    assert (low.min(), low.max()) == pytest.approx((-0.5, 1.5))
    assert (high.min(), high.max()) == pytest.approx((-0.5, 4.5))
    assert upward.get_xlabel() == "iterations of stage 2"
    assert not upward.yaxis_inverted()
    assert downward.yaxis_inverted()


def test_several_series_are_drawn_scene_by_scene_and_named_by_their_longest_row() -> None:
    first, second = curve_figures(made_up({"ours": {"detach": "none"}, "no rad": {"detach": "all"}}))
    assert (first.name, second.name) == ("curves-one", "curves-two")
    assert [text.get_text() for text in second.figure.legends[0].get_texts()] == [
        "ours, 1000 steps", "no rad, 1000 steps",
    ]  # fmt: skip
    ours, other = second.figure.axes[0].get_lines()
    assert ours.get_ydata() == pytest.approx([7.5, np.log10(300) + 5.5, 11.5])
    assert other.get_ydata() == pytest.approx([17.5, np.log10(300) + 15.5, 21.5])


@pytest.mark.parametrize("settings", [(100, 300), (100, 100, 300)])
def test_two_settings_are_no_curve(settings: tuple[int, ...]) -> None:
    assert curve_figures(made_up({"ours": {"detach": "none"}}, settings)) == []


def test_rows_that_differ_in_two_numbers_are_no_curve() -> None:
    made = made_up({"ours": {"detach": "none"}})
    for each in made["runs"]:
        if each["row"] == "ours-300":
            each["made_from"]["budget"]["incident_samples"] = 64
    assert curve_figures(made) == []


def test_pairs_of_curves_show_their_means_over_scenes_and_the_band_of_their_differences() -> None:
    made = made_up({"ours": {"weight": 0.2}, "no rad": {"weight": 0.0}})
    for each in made["runs"]:
        each["made_from"]["budget"]["name"] = "tiny"
        if (each["row"], each["scene"]) == ("ours-300", "two"):
            each["metrics"]["nvs/psnr"] += 1.0
    (sketch,) = effect_curve_figures(made)
    assert sketch.name == "effect-curves-1"
    assert "weight = 0.2 less 0.0" in sketch.caption
    above, below = (sketch.figure.axes[place] for place in (0, 2))
    ours, other = above.get_lines()
    assert ours.get_ydata() == pytest.approx([5.0, np.log10(300) + 3.5, 7.5])
    assert other.get_ydata() == pytest.approx([15.0, np.log10(300) + 13.0, 17.5])
    assert (ours.get_linestyle(), other.get_linestyle()) == ("-", "--")
    assert below.get_lines()[0].get_ydata() == pytest.approx([-10.0, -9.5, -10.0])
    band = below.collections[0].get_paths()[0].vertices
    assert {round(y, 2) for x, y in band if x == 300} == {round(-9.5 - 0.5 * 12.706, 2), round(-9.5 + 0.5 * 12.706, 2)}
    assert {y for x, y in band if x != 300} == {-10.0}
    assert [axes.yaxis_inverted() for axes in sketch.figure.axes] == [False, True, False, True]


def test_curves_that_differ_in_more_than_one_setting_are_no_pairs() -> None:
    assert (
        effect_curve_figures(made_up({"ours": {"weight": 0.2, "rate": 1}, "no rad": {"weight": 0.0, "rate": 2}})) == []
    )
    assert effect_curve_figures(made_up({"ours": {"weight": 0.2}})) == []
