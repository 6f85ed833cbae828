"""The oracle ladder's table and figure against values worked out by hand from a made-up run."""

import copy
from typing import Any

import numpy as np
import pytest

from made_up_run import cell, in_every_form, run, summary, t_interval
from radiogs_reports.analysis.ladder import ALL_SCENES, WHAT_THEY_MEAN, Rung, ladder_report, ladder_rungs
from radiogs_reports.analysis.report import Item, Report
from radiogs_reports.figures.ladder import ladder_figures
from radiogs_reports.run_folder import texts
from radiogs_reports.statistics import Estimate
from radiogs_reports.summary import Summary

SEEDS = (0, 1, 2)
GIVEN: dict[str, list[str]] = {
    "none": [], "shape-row": ["geometry"], "lit": ["light"], "all-but-geometry": ["light", "albedo"],
    "all-but-light": ["geometry", "albedo"], "whole": ["geometry", "light", "albedo"], "paint": ["albedo"],
    "all-but-albedo": ["geometry", "light"],
}  # fmt: skip
"""All choices of three parts; no indirect light and no roughness."""

GAIN = {
    "none": (0.0, 0.0, 0.0), "shape-row": (1.0, 1.2, 1.4), "lit": (-0.5, -0.5, -0.5), "paint": (6.0, 6.0, 6.0),
    "all-but-geometry": (5.0, 5.0, 5.0), "all-but-light": (6.0, 7.0, 8.0), "whole": (10.0, 10.0, 10.0),
    "all-but-albedo": (4.0, 4.0, 4.0),
}  # fmt: skip
"""dB over nothing given, by seed."""


def made_up(scenes: tuple[str, ...] = ("ball",)) -> Summary:
    """Another level for each scene and seed, so that only pairs give the gains; normals fall as albedo rises."""
    made = summary()
    made["title"], made["suite"], made["reference"] = "Parts & more", "oracles", "none"
    made["scenes"], made["seeds"], made["paper"], made["sheet"], made["published"] = [*scenes], [*SEEDS], [], [], {}
    made["rows"] = [
        {"key": key, "latex": "", "text": f"{key}_row", "seconds": 1.0, "given": given, "method": "RadioGS"}
        for key, given in GIVEN.items()
    ]
    made["columns"] = [
        {"key": "nvs/psnr", "label": "NVS PSNR", "unit": "dB", "direction": "up", "decimals": 2},
        {"key": "albedo/psnr", "label": "Albedo PSNR", "unit": "dB", "direction": "up", "decimals": 2},
        {"key": "normal/mae", "label": "Normal MAE", "unit": "deg", "direction": "down", "decimals": 1},
    ]
    made["cells"] = {key: {column["key"]: cell(30.0) for column in made["columns"]} for key in GIVEN}
    made["runs"] = [
        one(scene, place, row, seed) for place, scene in enumerate(scenes) for row in GIVEN for seed in SEEDS
    ]
    return made


def one(scene: str, place: int, row: str, seed: int) -> Any:
    gain, level = GAIN[row][seed] * (1 + place), 5.0 * seed + 3 * place
    psnr, angle = 20 + level + gain, 40 + level - 2 * gain
    values: dict[str, float | None] = {"nvs/psnr": psnr, "albedo/psnr": psnr, "normal/mae": angle}
    return run(row, scene, seed, f"{scene}-{row}-{seed}", values)


def report_of(made: Summary) -> Report:
    report = ladder_report(made)
    assert report is not None
    return report


def rung(made: Summary, column: str, scene: str = "ball") -> Rung:
    (found,) = [each for each in ladder_rungs(made) if (each.scene, each.column["key"]) == (scene, column)]
    return found


def item(made: Summary, place: int, head: str) -> Item:
    grid = report_of(made).grids[0]
    return grid.rows[place][grid.heads.index(head)]


EXPECTED: dict[str, tuple[float, dict[str, tuple[list[float], list[float]]]]] = {
    "nvs/psnr": (1, {
        "geometry": ([1.0, 1.2, 1.4], [5.0] * 3), "light": ([-0.5] * 3, [4.0, 3.0, 2.0]),
        "albedo": ([6.0] * 3, [6.0] * 3),
    }),
    # As giving albedo settles it, against 4 dB with geometry and light: alone they have -0.5 dB, and 1 to 1.4.
    "albedo/psnr": (1, {
        "geometry": ([1.0, 1.2, 1.4], [4.5] * 3), "light": ([-0.5] * 3, [3.0, 2.8, 2.6]),
        "albedo": ([6.0] * 3, [6.0] * 3),
    }),
    # Two degrees less for every decibel; against light and albedo.
    "normal/mae": (2, {
        "geometry": ([1.0, 1.2, 1.4], [5.0] * 3), "light": ([-0.5] * 3, [-1.0] * 3),
        "albedo": ([6.0] * 3, [5.5] * 3),
    }),
}  # fmt: skip


@pytest.mark.parametrize("column", EXPECTED)
def test_gains_are_paired_over_seeds_and_positive_where_the_part_helps(column: str) -> None:
    parts = rung(made_up(), column).parts
    factor, expected = EXPECTED[column]
    assert {*parts} == {*expected}
    for part, both in expected.items():
        for found, values in zip(parts[part], both, strict=True):
            assert found is not None
            assert found.mean == pytest.approx(factor * np.mean(values))
            if len(set(values)) > 1:
                assert (found.low, found.high) == pytest.approx(t_interval(factor * np.array(values)))


def test_over_several_scenes_there_is_a_rung_for_each_and_one_for_all() -> None:
    made = made_up(("ball", "room"))
    assert {each.scene for each in ladder_rungs(made)} == {"ball", "room", ALL_SCENES}
    whole = rung(made, "albedo/psnr", ALL_SCENES)
    first = whole.parts["geometry"].first_in
    assert first is not None
    assert (first.mean, first.units, first.values) == (pytest.approx(np.mean([1.0, 1.2, 1.4, 2.0, 2.4, 2.8])), 2, 6)
    assert whole.nothing is not None
    assert whole.nothing.mean == pytest.approx(20 + 5 + 1.5)
    room = rung(made, "albedo/psnr", "room").parts["geometry"].first_in
    assert room is not None
    assert room.mean == pytest.approx(2.4)


def test_the_table_has_the_values_computed_by_hand() -> None:
    made = made_up()
    said = {head: item(made, 1, head).text for head in report_of(made).grids[0].heads}
    # Half-widths: 4.3027 s / sqrt 3, with s = 5 of the levels and 0.2 of geometry.
    assert said == {
        "scene": "ball", "metric": "Albedo PSNR ↑ (dB)", "nothing given": "25.00 ± 12.42",
        "geometry, first in": "+1.20 ± 0.50", "geometry, last out": "+4.50 ± 0.00",
        "light, first in": "-0.50 ± 0.00", "light, last out": "+2.80 ± 0.50",
        "albedo, first in": "(+6.00 ± 0.00)", "albedo, last out": "(+6.00 ± 0.00)",
        "everything given": "29.00 ± 12.42",
    }  # fmt: skip
    assert item(made, 0, "everything given").text == "35.00 ± 12.42"
    assert item(made, 2, "geometry, first in").text.startswith("(+2.4")  # normals are the geometry itself
    assert item(made, 2, "albedo, first in").text == "+12.0 ± 0.0"


def test_the_sentences_name_the_parts_that_count_most_and_what_the_values_mean() -> None:
    assert report_of(made_up()).sentences == [
        WHAT_THEY_MEAN,
        "ball, NVS PSNR, dB: 25.00 with nothing given, 35.00 with everything; first in, albedo counts most (+6.00);"
        " last out, albedo counts most (+6.00).",
        "ball, Albedo PSNR, dB: 25.00 with nothing given, 29.00 with everything but albedo; first in, geometry counts"
        " most (+1.20); last out, geometry counts most (+4.50).",
        "ball, Normal MAE, deg: 45.0 with nothing given, 35.0 with everything but geometry; first in, albedo counts"
        " most (+12.0); last out, albedo counts most (+11.0).",
    ]


def test_a_sentence_states_that_no_part_helps() -> None:
    made = made_up()
    for each in made["runs"]:
        each["metrics"]["nvs/psnr"] = 30.0
    assert (
        report_of(made)
        .sentences[1]
        .endswith("first in, no other part makes it better; last out, no other part makes it better.")
    )


def test_a_value_that_needs_a_missing_row_is_missing() -> None:
    made = made_up()
    made["rows"] = [row for row in made["rows"] if row["key"] != "all-but-light"]
    assert rung(made, "nvs/psnr").parts["light"].last_out is None
    assert item(made, 0, "light, last out").text == "n/a"
    assert item(made, 0, "light, first in").text == "-0.50 ± 0.00"


def test_a_seed_that_one_row_lacks_does_not_count() -> None:
    made = made_up()
    for each in made["runs"]:
        if (each["row"], each["seed"]) in (("none", 0), ("shape-row", 2)):
            each["metrics"] = {}
    found = rung(made, "albedo/psnr").parts["geometry"].first_in
    assert found == Estimate(pytest.approx(1.2), None, None, 1)
    assert item(made, 0, "geometry, first in").text == "+1.20"


def test_each_method_has_rungs_of_its_own() -> None:
    made = made_up()
    other = copy.deepcopy(made)
    for row in other["rows"]:
        row["key"], row["method"] = f"b-{row['key']}", "Other"
    for each in other["runs"]:
        each["row"] = f"b-{each['row']}"
        each["metrics"] = {key: 2 * (value or 0) for key, value in each["metrics"].items()}
    made["rows"] += other["rows"]
    made["runs"] += other["runs"]
    made["cells"] |= {f"b-{key}": cells for key, cells in made["cells"].items()}
    rungs = [each for each in ladder_rungs(made) if each.column["key"] == "nvs/psnr"]
    found = {each.method: each.parts["geometry"].first_in for each in rungs}
    means = {name: each.mean for name, each in found.items() if each is not None}
    assert means == {"RadioGS": pytest.approx(1.2), "Other": pytest.approx(2.4)}
    assert "ball, Other" in {row[0].text for row in report_of(made).grids[0].rows}
    assert [sketch.name for sketch in ladder_figures(made)] == ["ladder-RadioGS-ball", "ladder-Other-ball"]
    several = ladder_figures(made_up(("ball", "room")))
    assert {sketch.name: sketch.on_page for sketch in several} == {
        "ladder-ball": False, "ladder-room": False, "ladder-all-scenes": True,
    }  # fmt: skip


def test_a_run_without_given_parts_has_no_ladder() -> None:
    assert ladder_report(summary()) is None
    assert ladder_figures(summary()) == []
    assert not any("ladder" in name for name in texts(summary()))


def test_the_figure_has_a_panel_for_each_metric_and_two_bars_for_each_part() -> None:
    (sketch,) = ladder_figures(made_up())
    assert sketch.on_page
    images, albedo, normal = [axes for axes in sketch.figure.axes if axes.get_visible()]
    assert [label.get_text() for label in images.get_yticklabels()] == ["geometry", "light", "albedo"]
    widths = sorted(round(patch.get_width(), 3) for patch in images.patches)  # type: ignore[attr-defined]
    assert widths == [-0.5, 1.2, 3.0, 5.0, 6.0, 6.0]
    assert images.get_xlim() == pytest.approx((-1.25 * 0.5 - 0.08 * 7.5, 7.5))
    assert [text.get_text() for text in images.texts] == []
    # The albedo's own bars do not set the axis: geometry's last out does. They are cut off, and have their value.
    assert albedo.get_xlim()[1] == pytest.approx(1.25 * 4.5)
    assert [text.get_text() for text in albedo.texts] == ["+6.00", "+6.00"]
    assert normal.get_xlim()[1] == pytest.approx(1.25 * 12.0)


def test_noise_beside_the_bar_of_the_part_itself_is_not_made_large() -> None:
    made = made_up()
    for each in made["runs"]:
        each["metrics"]["normal/mae"] = 5.0 if "geometry" in GIVEN[each["row"]] else 45.0 + 0.01 * len(each["row"])
    (sketch,) = ladder_figures(made)
    assert sketch.figure.axes[2].get_xlim()[1] == pytest.approx(1.25 * 0.1 * 40.0, rel=0.01)


def test_every_form_has_the_values_and_the_csv_a_line_for_each_part() -> None:
    records = in_every_form(made_up(), "ladder").set_index(["metric", "part"])
    record = records.loc[("nvs/psnr", "light")]
    assert (record["method"], record["scene"]) == ("RadioGS", "ball")
    assert record[["first_in", "last_out", "nothing_given", "everything_given"]].tolist() == pytest.approx(
        [-0.5, 3.0, 25.0, 35.0]
    )
    assert record[["last_out_low", "last_out_high"]].tolist() == pytest.approx(list(t_interval([4.0, 3.0, 2.0])))
