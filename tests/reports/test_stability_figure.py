"""The figure of the hard cases: drawn where a run has such cells, worse to the right."""

from pathlib import Path

import numpy as np
import pytest

from made_up_run import run, summary
from radiogs_reports.figures.stability import EPS, HIGHEST, LOWEST, stability_figure
from radiogs_reports.summary import Summary

CURVES = {
    "conditions": [1.0, 1e-2, 1e-4],
    "curve/trace/forward": [1e-7, 1e-5, np.inf],
    "curve/trace/forward tolerance": [1e-6, 1e-4, 1e2],
    "curve/trace/gradient": [1e-6, 0.0, 1e-3],
    "curve/trace/gradient tolerance": [1e-3, 1e-3, 1e-1],
    "guards/full_rays": [0.0, 0.0, 4.0],
}


@pytest.fixture
def made(tmp_path: Path) -> Summary:
    cells = summary()
    cells["sheet"], cells["runs"] = [], []
    for row, axis in (("ours", "grazing"), ("no-rad", "sun")):
        cell = run(row, "hard-cases", 0, axis, {})
        cell["made_from"] = {"experiment": "stability", "settings": {axis: 3.0}}
        cells["runs"].append(cell)
        (tmp_path / "cells").mkdir(exist_ok=True)
        np.savez(tmp_path / "cells" / f"{axis}.npz", allow_pickle=False, **{k: np.array(v) for k, v in CURVES.items()})
    return cells


def test_each_axis_has_a_panel_for_values_and_one_for_gradients(made: Summary, tmp_path: Path) -> None:
    (sketch,) = stability_figure(made, tmp_path)
    shown = [axes for axes in sketch.figure.axes if axes.get_visible()]
    assert [axes.get_title() for axes in shown if axes.get_title()] == ["Ours", r"lambda_rad = 0"]
    assert [axes.get_xlabel() for axes in shown if axes.get_xlabel()] == [
        "cosine of normal and ray",
        "radiance of the sun",
    ]
    assert len(shown) == 4
    grazing = shown[0]
    assert grazing.get_xlim()[0] > grazing.get_xlim()[1], "worse is to the right"
    assert shown[1].get_xlim()[0] < shown[1].get_xlim()[1]
    lines = {line.get_color(): line for line in grazing.lines if line.get_linestyle() == "-"}
    assert lines["#999999"].get_ydata()[0] == EPS
    curve = next(line for colour, line in lines.items() if colour != "#999999")
    assert list(curve.get_ydata()) == [1e-7, 1e-5, HIGHEST], "what is infinite is drawn at the edge"
    (tick,) = [line for line in grazing.lines if line.get_marker() == "|"]
    assert list(tick.get_xdata()) == [1e-4]
    slopes = next(
        line for line in shown[2].lines if line.get_marker() not in ("None", "|") and line.get_linestyle() == "-"
    )
    assert np.isnan(slopes.get_ydata()[1]), "no error has no logarithm"
    assert np.nanmin(slopes.get_ydata()) > LOWEST


def test_a_run_without_hard_cases_has_no_such_figure(tmp_path: Path) -> None:
    assert stability_figure(summary(), tmp_path) == []
