"""Fine-tuning: which rows are compared, when it pays, and what the plots hold."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from made_up_run import arrays, cell, run, summary, write_run
from radiogs_reports.figures.finetuning import RelightTimes, finetuning_figures, times_of, tunings
from radiogs_reports.summary import ModesSummary, Summary

ROWS = {"split-sum": ("pbr", 1.0), "rays-2": ("finetuned", 0.1), "rays-8": ("finetuned", 0.4),
        "surfels-8": ("surfels", 0.8), "surfels-2": ("surfels", 0.2)}  # fmt: skip
"""The way of relighting, and iterations as a share of 20; not in order."""

MILLISECONDS = {"split-sum": (50.0, 10.0), "rays-2": (90.0, 12.0), "rays-8": (200.0, 12.0), "surfels-8": (850.0, 2.0),
                "surfels-2": (210.0, 2.0)}  # fmt: skip


MODES: ModesSummary = {
    "field": "relighting", "default": "pbr", "by_steps": ["surfels", "finetuned"], "steps": "finetune_iterations",
    "titles": {"pbr": "split sum", "finetuned": "rays to tuned surfels", "surfels": "tuned surfels"},
}  # fmt: skip


def made_up() -> Summary:
    made = summary()
    made["reference"], made["paper"], made["published"] = "split-sum", [], {}
    made["columns"] = [
        {"key": "relight/psnr", "label": "Relight PSNR", "unit": "dB", "direction": "up", "decimals": 2},
        {"key": "render/ms", "label": "Rendering time", "unit": "ms", "direction": "down", "decimals": 2},
        {"key": "prepare/ms", "label": "Preparing a light time", "unit": "ms", "direction": "down", "decimals": 2},
    ]
    made["rows"] = [{"key": row, "latex": row, "text": row, "seconds": 1.0} for row in ROWS]
    made["cells"], made["runs"], made["sheet"] = {}, [], []
    made["relighting"] = {"radiogs": MODES}
    for place, (row, (mode, share)) in enumerate(ROWS.items()):
        prepare, frame = MILLISECONDS[row]
        metrics: dict[str, float | None] = {"relight/psnr": 20.0 + place, "render/ms": frame, "prepare/ms": prepare}
        made["cells"][row] = {key: cell(value, 0.25) for key, value in metrics.items()}
        each = run(row, "my_scene", 0, row, metrics)
        budget: dict[str, Any] = {"name": row, "finetune_iterations": round(20 * share), "incident_samples": 8}
        each["made_from"] = {"variant": {"relighting": mode, "detach": "none"}, "budget": budget, "method": "radiogs"}
        made["runs"].append(each)
        made["sheet"].append(
            {"row": row, "scene": "my_scene", "view": "test_004", "arrays": f"cells/{row}.npz", "light": "sky"}
        )
    return made


def test_rows_are_recognised_by_the_content_of_their_keys() -> None:
    made = made_up()
    found = [(each.row, each.iterations) for each in tunings(made)]
    assert found == [("surfels-2", 4), ("surfels-8", 16), ("rays-2", 2), ("rays-8", 8)]
    made["runs"][1]["made_from"]["budget"]["incident_samples"] = 16  # then it differs in another knob too
    assert [each.row for each in tunings(made)] == ["surfels-2", "surfels-8"]
    made["reference"] = "surfels-8"
    assert tunings(made) == []


def test_modes_come_from_the_runs_record_of_the_method() -> None:
    """Fields may be nested, and modes have any names."""
    made = made_up()
    for each in made["runs"]:
        content = each["made_from"]
        content["variant"] = {"shown": {"way": content["variant"]["relighting"].upper()}}
        content["budget"] = {"name": "x", "light": {"steps": content["budget"]["finetune_iterations"]}}
    assert tunings(made) == [], "the field that was recorded is another one"
    made["relighting"] = {
        "radiogs": {
            "field": "shown.way", "default": "PBR", "by_steps": ["FINETUNED", "SURFELS"], "steps": "light.steps",
            "titles": {"FINETUNED": "learnt"},
        }
    }  # fmt: skip
    found = tunings(made)
    assert [(each.row, each.iterations) for each in found] == [
        ("rays-2", 2), ("rays-8", 8), ("surfels-2", 4), ("surfels-8", 16)
    ]  # fmt: skip
    assert [each.mode.title for each in found] == ["learnt", "learnt", "SURFELS", "SURFELS"]
    made["relighting"] = {"another": made["relighting"]["radiogs"]}
    assert tunings(made) == [], "they are another method's"


def test_a_run_without_fine_tuning_has_no_such_figure(tmp_path: Path) -> None:
    made = summary()
    assert finetuning_figures(made, write_run(tmp_path, made)) == []


@pytest.mark.parametrize(
    ("mine", "other", "said"),
    [
        (RelightTimes(5.0, 0.01), RelightTimes(1.0, 0.05), "ahead after 100 frames"),
        (RelightTimes(1.0, 0.05), RelightTimes(5.0, 0.01), "ahead for 100 frames"),
        (RelightTimes(1.0, 0.01), RelightTimes(5.0, 0.05), "always ahead"),
        (RelightTimes(5.0, 0.05), RelightTimes(1.0, 0.01), "never ahead"),
        (RelightTimes(1.0, 0.01), RelightTimes(0.999, 0.05), "always ahead"),
    ],
)
def test_when_a_row_is_ahead_is_where_the_lines_meet(mine: RelightTimes, other: RelightTimes, said: str) -> None:
    """Judged by a root of the difference of both lines between the first and a very late frame."""

    def lead(frames: float) -> float:
        return float(other.after(np.array(frames)) - mine.after(np.array(frames)))

    assert mine.versus(other) == said
    if "frames" in said:
        assert mine.break_even(other) == pytest.approx(brentq(lead, 1, 1e9))
        assert (lead(1) > 0) == ("for" in said)
    else:
        assert mine.break_even(other) is None
        assert (lead(1) > 0) == (lead(1e9) > 0) == ("always" in said)


def test_curves_hold_the_metrics_by_iterations_and_better_is_up(tmp_path: Path) -> None:
    made = made_up()
    sketches = {each.name: each.figure for each in finetuning_figures(made, write_run(tmp_path, made))}
    assert list(sketches) == ["finetuning", "finetuning-crossover", "my_scene-finetuning"]
    (axes,) = [axes for axes in sketches["finetuning"].axes if axes.get_visible()]
    lines = [line.get_xydata() for line in axes.get_lines() if len(line.get_xydata()) == 2]
    assert any(line == pytest.approx(np.array([[4, 24], [16, 23]])) for line in lines)
    assert any(line == pytest.approx(np.array([[2, 21], [8, 22]])) for line in lines)
    assert axes.get_ylim()[0] < axes.get_ylim()[1]


def test_points_of_the_crossover_lie_on_both_lines(tmp_path: Path) -> None:
    made = made_up()
    (figure,) = [each.figure for each in finetuning_figures(made, write_run(tmp_path, made)) if "cross" in each.name]
    marks = [line.get_xydata()[0] for line in figure.axes[0].get_lines() if line.get_marker() == "o"]
    # 0.16 s and 0.8 s later, 8 ms a frame faster.
    assert marks == [pytest.approx([20, 0.25]), pytest.approx([100, 1.05])]
    reference = times_of(made, "split-sum")
    assert reference is not None
    assert [float(reference.after(np.array(frames))) for frames, _ in marks] == pytest.approx([0.25, 1.05])
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "4 iterations: ahead after 20 frames" in labels
    assert "8 iterations: never ahead" in labels


def test_pictures_are_ordered_by_iterations_and_end_with_the_references(tmp_path: Path) -> None:
    made = made_up()
    (figure,) = [
        each.figure for each in finetuning_figures(made, write_run(tmp_path, made)) if each.name.startswith("my_scene")
    ]
    tiles = [axes for axes in figure.axes if axes.get_visible()]
    assert [axes.get_title() for axes in tiles] == [
        "4 iterations", "16 iterations", "split-sum", "truth", "2 iterations", "8 iterations",
    ]  # fmt: skip
    shown = [arrays(list(ROWS).index(row))["render/relit"] for row in ("surfels-2", "surfels-8", "split-sum")]
    for axes, image in zip(tiles, shown, strict=False):
        assert np.array_equal(axes.images[0].get_array(), np.rint(image * 255))
