"""Reports of methods that are not RadioGS: other stages, other budgets, no surfels, no rays, no plan, no L_rad."""

from pathlib import Path
from typing import Any

import pytest

from made_up_run import of_another_method, run, summary, write_run
from radiogs_reports.analysis.audit import audit_report
from radiogs_reports.analysis.cost import cost_report
from radiogs_reports.analysis.cost_knobs import knobs
from radiogs_reports.analysis.cost_progress import equal_time
from radiogs_reports.figures.audit import audit_figure
from radiogs_reports.figures.convergence import convergence_figures
from radiogs_reports.figures.cost import knob_figures
from radiogs_reports.figures.finetuning import tunings
from radiogs_reports.page.tables import cells_table
from radiogs_reports.run_folder import write_reports
from radiogs_reports.summary import Summary

ONE = {"fit": "fitting"}
THREE = {"zeta": "geometry", "light": "light & materials", "alpha": "joint_refinement"}
"""Names in another order than the alphabet's; titles that LaTeX and HTML must escape."""

EACH = pytest.mark.parametrize("stages", [ONE, THREE], ids=["one stage", "three stages"])


def made_up(stages: dict[str, str]) -> Summary:
    """Two rows that differ in the number of steps, two seeds each."""
    made = summary()
    made["columns"], made["published"], made["paper"] = made["columns"][:2], {}, []
    made["runs"] = [
        of_another_method(
            run(row, "my_scene", seed, f"{row}{seed}", {"nvs/psnr": 30.0 + seed, "normal/mae": 7.0}), stages, changes
        )
        for row, changes in (("ours", {}), ("no-rad", {"steps": 4}))
        for seed in made["seeds"]
    ]
    made["sheet"][0]["arrays"] = "cells/ours0.npz"
    return made


@EACH
def test_all_reports_are_written(stages: dict[str, str], tmp_path: Path) -> None:
    written = {path.name for path in write_reports(write_run(tmp_path, made_up(stages), size=8))}
    assert {"ablations.tex", "cost.md", "cost.png", "convergence-losses.png", "report.html", "report.tex"} <= written
    assert not {"audit.md", "audit.png", "cost-in-rays.png"} & written
    assert "stage 2" not in (tmp_path / "tables" / "cost.md").read_text()


@EACH
def test_the_last_stage_in_the_list_is_the_one_that_was_scored(stages: dict[str, str]) -> None:
    made = made_up(stages)
    report = cost_report(made)
    assert report is not None
    assert [knob.text for knob in knobs(made)] == ["steps"], "a field without a given text is called by its own name"
    title = list(stages.values())[-1]
    before = 2.0 * (len(stages) - 1)
    share = 100 * (1.0 / (before + 2.0))
    assert report.sentences[-1] == (
        f"The second half of {title}: NVS PSNR +1.00 ± 0.00 dB, Normal MAE -1.00 ± 0.00 degrees,"
        f" for {share:.0f} % of the training time."
    )
    seconds = [line[1].value for line in equal_time(made).rows if line[0].text == "NVS PSNR"]
    assert seconds == pytest.approx([before + 0.25 * step for step in (1, 2, 4, 8)])


@EACH
def test_each_stage_has_a_panel_under_its_title_with_the_total_loss(stages: dict[str, str]) -> None:
    losses, metrics = convergence_figures(made_up(stages))
    panels = [axes for axes in losses.figure.axes if axes.get_visible()]
    assert [axes.get_title() for axes in panels] == [f"all losses (weighted), {title}" for title in stages.values()]
    for axes in panels:
        assert list(axes.get_lines()[0].get_ydata()) == pytest.approx([4.0 / step for step in (1, 2, 4, 8)])
    assert "sum of all weighted losses" in losses.caption
    assert f"Metrics during {list(stages.values())[-1]}," in metrics.caption


@EACH
def test_a_value_that_the_method_lacks_is_missing_with_a_reason(stages: dict[str, str]) -> None:
    made = made_up(stages)
    table = cells_table(made)
    (place,) = [place for place, column in enumerate(table.columns) if column.label == "surfels"]
    assert [(row.cells[place].text, row.cells[place].reason) for row in table.rows] == [
        ("n/a", "the result holds no number of surfels")
    ] * 4
    assert [sketch.name for sketch in knob_figures(made)] == ["cost", "cost-doublings"], "no figure of rays"
    assert tunings(made) == []


@EACH
def test_an_audit_of_a_method_without_plans_is_empty(stages: dict[str, str]) -> None:
    made = made_up(stages)
    for each in made["runs"]:
        each["made_from"]["experiment"] = "audit"
    assert audit_report(made) is None
    assert audit_figure(made) == []
    made["reference"] = None
    assert audit_report(made) is None


def test_rows_of_two_methods_stand_in_one_run(tmp_path: Path) -> None:
    """Reference of two stages with L_rad, the other row of one stage without: no knob joins them."""
    made = made_up(ONE)
    for place in (0, 1):
        seed = made["runs"][place]["seed"]
        made["runs"][place] = run("ours", "my_scene", seed, f"ours{seed}", {"nvs/psnr": 30.0, "normal/mae": 7.0})
        made["runs"][place]["made_from"] = {"variant": {"detach": "none"}, "budget": {"name": "tiny", "steps": 8}}
    assert cost_report(made) is None
    losses, metrics = convergence_figures(made)
    titles = [axes.get_title() for axes in losses.figure.axes if axes.get_visible()]
    assert titles == [
        *(f"all losses (weighted), {stage}" for stage in ("stage 1", "stage 2")),
        r"$L_\mathrm{rad}$ (weighted), stage 2",
        "all losses (weighted), fitting",
    ]
    assert "Metrics during the last stage," in metrics.caption
    assert len(metrics.figure.axes[0].get_lines()) == 1, "both rows were scored alike, so they are one line"
    assert (tmp_path / "report.html") in write_reports(write_run(tmp_path, made, size=8))


@pytest.mark.parametrize("broken", [{"steps": 4.5}, {"steps": None}, {"steps": True}, {"steps": 0}, {"more": 1}])
def test_only_positive_whole_numbers_are_knobs(broken: dict[str, Any]) -> None:
    made = made_up(ONE)
    for each in made["runs"]:
        if each["row"] == "no-rad":
            each["made_from"]["budget"] = {"name": "tiny", "steps": 8, **broken}
    assert cost_report(made) is None
