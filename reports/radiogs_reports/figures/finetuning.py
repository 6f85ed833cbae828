"""Fine-tuning for a new light: quality by iterations and by what it takes, and for how many frames it pays."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from ..analysis.finetuning import MODES, Times, Tuned, times_of, tunings
from ..summary import ColumnSummary, Summary, reference_of
from ..write.plain import ARROWS
from .canvas import (
    COLOURS,
    STYLE,
    TILE,
    Sketch,
    blank,
    file_name,
    hide_empty,
    name_row,
    plain,
    plain_numbers,
    show,
    wrapped,
)
from .views import scene_views

TASK = "relight/"
ACROSS = 3
PANEL = (2.6, 2.3)
WIDE = 7.8
"""Inches: room for three columns of a legend."""

BEYOND = 10.0
"""The axis of frames ends so many times beyond the last frame at which a row and the reference are even."""


def finetuning_figures(summary: Summary, out: Path) -> list[Sketch]:
    """Curves, what it takes until it pays, and pictures; none where no rows differ in iterations of fine-tuning."""
    tuned = tunings(summary)
    if not tuned:
        return []
    return [*_progression(summary, tuned), *_crossover(summary, tuned), *_pictures(summary, out, tuned)]


def colour_of(mode: str) -> str:
    """Of a mode's lines."""
    return COLOURS[list(MODES).index(mode)]


def by_mode(tuned: list[Tuned]) -> dict[str, list[Tuned]]:
    """The rows of each mode that there are, fewest iterations first."""
    return {mode: mine for mode in MODES if (mine := [each for each in tuned if each.mode == mode])}


def _progression(summary: Summary, tuned: list[Tuned]) -> list[Sketch]:
    columns = _measured(summary, tuned)
    if not columns:
        return []
    with rc_context(STYLE):
        lines = -(-len(columns) // ACROSS)
        figure = blank(PANEL[0] * ACROSS, PANEL[1] * lines + 0.4)
        grid = figure.subplots(lines, ACROSS, squeeze=False).ravel()
        for axes, column in zip(grid, columns, strict=False):
            _panel(axes, summary, column, tuned, lambda each: float(each.iterations))
            axes.set_xlabel("iterations of fine-tuning")
        hide_empty(grid)
        figure.legend(handles=_handles(summary, tuned), loc="outside lower center", ncols=3, frameon=False)
    caption = (
        "Fine-tuning the surfels for a new light: figures by its iterations, means over the finished cells; dashed:"
        " without it; bars: 95 % interval of the paired difference to that."
    )
    return [Sketch("finetuning", caption, figure, on_page=True)]


def _measured(summary: Summary, tuned: list[Tuned]) -> list[ColumnSummary]:
    """Columns of relighting that every row has a figure for."""
    cells = [summary["cells"][row] for row in (reference_of(summary), *(each.row for each in tuned))]
    relit = [column for column in summary["columns"] if column["key"].startswith(TASK)]
    return [column for column in relit if all(each[column["key"]]["mean"] is not None for each in cells)]


def _panel(
    axes: Axes, summary: Summary, column: ColumnSummary, tuned: list[Tuned], place: Callable[[Tuned], float]
) -> None:
    def figure(row: str) -> float:
        mean = summary["cells"][row][column["key"]]["mean"]
        assert mean is not None  # only such columns are drawn
        return mean

    for mode, mine in by_mode(tuned).items():
        differences = [summary["cells"][each.row][column["key"]]["difference"] for each in mine]
        reaches = [0.0 if each is None or each["high"] is None else each["high"] - each["mean"] for each in differences]
        axes.errorbar(
            [place(each) for each in mine], [figure(each.row) for each in mine], reaches, color=colour_of(mode),
            marker="o", markersize=4, linewidth=1.0, elinewidth=0.6,
        )  # fmt: skip
    axes.axhline(figure(reference_of(summary)), color="#000000", linestyle="--", linewidth=0.9, zorder=1)
    axes.set_xscale("log")
    plain_numbers(axes.xaxis)
    if column["direction"] == "down":
        axes.invert_yaxis()  # better is higher up
    unit = f" ({column['unit']})" if column["unit"] else ""
    axes.set_title(plain(f"{column['label']} {ARROWS[column['direction']]}{unit}"))
    axes.grid(color="#e4e4e4", linewidth=0.5)
    axes.set_axisbelow(True)


def _handles(summary: Summary, tuned: list[Tuned]) -> list[Line2D]:
    texts = {row["key"]: plain(row["text"]) for row in summary["rows"]}
    handles = [Line2D([], [], color="#000000", linestyle="--", linewidth=0.9, label=texts[reference_of(summary)])]
    handles += [
        Line2D([], [], color=colour_of(mode), marker="o", markersize=4, linewidth=1.0, label=MODES[mode])
        for mode in by_mode(tuned)
    ]
    return handles


def _crossover(summary: Summary, tuned: list[Tuned]) -> list[Sketch]:
    reference = times_of(summary, reference_of(summary))
    times = {each.row: mine for each in tuned if (mine := times_of(summary, each.row)) is not None}
    timed = [each for each in tuned if each.row in times]
    if reference is None or not timed:
        return []
    quality = _measured(summary, timed)[:1]
    with rc_context(STYLE):
        figure = blank(WIDE, 2.7 + 0.17 * (1 + max(map(len, by_mode(timed).values()))))
        axes, *others = figure.subplots(1, 1 + len(quality), squeeze=False).ravel()
        _totals(axes, timed, times, reference)
        for other, column in zip(others, quality, strict=True):
            _panel(other, summary, column, timed, lambda each: times[each.row].prepare)
            other.set_xlabel("seconds to make a light ready")
        modes = by_mode(timed)
        said = {each.row: times[each.row].versus(reference) for each in timed}
        columns = [_handles(summary, []), *(_timed_handles(mode, mine, said) for mode, mine in modes.items())]
        figure.legend(handles=_in_columns(columns), loc="outside lower center", ncols=1 + len(modes), frameon=False)
    caption = (
        "When fine-tuning pays: seconds for a number of frames under one light, making it ready included (milliseconds"
        f" of a light and of a frame are means over the finished cells, on {summary['machine']}). Points: where a"
        " fine-tuned row and rays that meet split-sum radiance (dashed) have taken as long."
    )
    if quality:
        caption += " Right: what the time to make ready gives; dashed: without fine-tuning."
    return [Sketch("finetuning-crossover", caption, figure, on_page=True)]


def _totals(axes: Axes, timed: list[Tuned], times: dict[str, Times], reference: Times) -> None:
    """Seconds by frames, and where each row and the reference have taken as long."""
    met = {each.row: times[each.row].meets(reference) for each in timed}
    frames = np.geomspace(1, BEYOND * max([10.0, *(each for each in met.values() if each is not None)]), 200)
    axes.plot(frames, reference.after(frames), color="#000000", linestyle="--", linewidth=0.9)
    for mode, mine in by_mode(timed).items():
        for place, each in enumerate(mine):
            colour, after, even = colour_of(mode), times[each.row].after, met[each.row]
            axes.plot(frames, after(frames), color=colour, alpha=_alpha(place, mine), linewidth=1)
            if even is not None:
                axes.plot(even, after(np.array(even)), "o", color=colour, markersize=4)
    axes.set_xscale("log")
    axes.set_yscale("log")
    plain_numbers(axes.xaxis)
    plain_numbers(axes.yaxis)
    axes.set_xlabel("frames under one light")
    axes.set_title("seconds in all ↓")
    axes.grid(color="#e4e4e4", linewidth=0.5)
    axes.set_axisbelow(True)


def _alpha(place: int, mine: list[Tuned]) -> float:
    """Fewer iterations are paler."""
    return 0.25 + 0.75 * (place + 1) / len(mine)


def _timed_handles(mode: str, mine: list[Tuned], said: dict[str, str]) -> list[Line2D]:
    """A legend's column: the mode, then its rows and when they pay."""
    lines = [
        Line2D([], [], color=colour_of(mode), alpha=_alpha(place, mine), linewidth=1,
               label=f"{_iterations(each)}: {said[each.row]}")
        for place, each in enumerate(mine)
    ]  # fmt: skip
    return [Line2D([], [], linestyle="", label=MODES[mode]), *lines]


def _in_columns(columns: list[list[Line2D]]) -> list[Line2D]:
    """Handles for a legend of so many columns, which are filled one after the other: shorter ones end in nothing."""
    longest = max(map(len, columns))
    nothing = Line2D([], [], linestyle="", label=" ")
    return [handle for column in columns for handle in (*column, *[nothing] * (longest - len(column)))]


def _iterations(tuned: Tuned) -> str:
    return f"{tuned.iterations} iterations" if tuned.iterations > 1 else "1 iteration"


def _pictures(summary: Summary, out: Path, tuned: list[Tuned]) -> list[Sketch]:
    """For each scene the view of each mode by iterations, then without fine-tuning, and the truth."""
    texts = {row["key"]: plain(row["text"]) for row in summary["rows"]}
    sketches = []
    for views in scene_views(summary, out):
        rows = [entry["row"] for entry in summary["sheet"] if entry["scene"] == views.scene]
        found = {row: part["relit"] for row, (_, part) in zip(rows, views.rows, strict=True) if "relit" in part}
        modes = {mode: mine for mode, mine in by_mode(tuned).items() if all(each.row in found for each in mine)}
        reference = reference_of(summary)
        if "relit" not in views.truth or reference not in found or not modes:
            continue
        beside = [(texts[reference], found[reference]), ("truth", views.truth["relit"])]
        across = max(map(len, modes.values()))
        with rc_context(STYLE):
            figure = blank(TILE * (across + len(beside)) + 0.4, (TILE + 0.2) * len(modes))
            grid = figure.subplots(len(modes), across + len(beside), squeeze=False)
            for line, (mode, mine) in zip(grid, modes.items(), strict=True):
                for axes, each in zip(line, mine, strict=False):
                    show(axes, found[each.row])
                    axes.set_title(_iterations(each))
                name_row(line[0], wrapped(MODES[mode]))
            for axes, (label, image) in zip(grid[0, across:], beside, strict=True):
                show(axes, image)
                axes.set_title(wrapped(label))
            hide_empty(grid)
        light = f" under {views.light}" if views.light else ""
        caption = f"{views.scene}, view {views.view}{light}, as fine-tuning for that light goes on."
        sketches.append(Sketch(file_name(views.scene, "finetuning"), caption, figure))
    return sketches
