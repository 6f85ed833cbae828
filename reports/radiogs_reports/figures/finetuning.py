"""Figures of fine-tuning for a new light: quality over iterations, after how many frames it pays, and pictures."""

from collections.abc import Callable
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from ..analysis.samples import changed_fields, flat, made_from
from ..maps import Image
from ..summary import ColumnSummary, ModesSummary, Summary, reference_of, row_texts
from ..wording import count_of, mean_over, population_of
from .axes import add_grid, logarithmic, metric_over_numbers
from .canvas import COLOURS, Sketch, blank, file_name, hide_empty, panels, plain, show, tiles, wrapped
from .views import SceneViews, scene_views

MILLISECONDS = ("prepare/ms", "render/ms")
"""Columns: preparing for one light, and rendering one frame under it."""


class Mode(NamedTuple):
    """A mode of relighting with fine-tuning: its index among the method's such modes, and its title."""

    number: int
    title: str

    @property
    def colour(self) -> str:
        """Colour of its lines."""
        return COLOURS[self.number % len(COLOURS)]


class Tuned(NamedTuple):
    """A row that fine-tunes: its mode and its number of iterations."""

    row: str
    mode: Mode
    iterations: int

    @property
    def text(self) -> str:
        """Its number of iterations in words."""
        return count_of(self.iterations, "iteration")


class RelightTimes(NamedTuple):
    """Seconds to prepare for a light, and seconds per frame under it."""

    prepare: float
    frame: float

    def after(self, frames: NDArray[np.float64]) -> NDArray[np.float64]:
        """Total seconds for a number of frames under one light."""
        return self.prepare + frames * self.frame

    def break_even(self, other: "RelightTimes") -> float | None:
        """The number of frames, at least one, after which both totals are equal; None if one is always ahead."""
        later, saved = self.prepare - other.prepare, other.frame - self.frame
        return later / saved if later * saved > 0 and later / saved >= 1 else None

    def versus(self, other: "RelightTimes") -> str:
        """For which numbers of frames this total is the smaller one, as text."""
        frames = self.break_even(other)
        if frames is None:
            return "always ahead" if self.prepare + self.frame < other.prepare + other.frame else "never ahead"
        if self.frame < other.frame:
            return f"ahead after {frames:.0f} frames"
        return f"ahead for {frames:.0f} frames"


TASK = "relight/"
"""Columns of relighting begin with it."""

ACROSS = 3
PANEL = (2.6, 2.3)
WIDE = 7.8
"""Width in inches that fits three columns of a legend."""

BEYOND = 10.0
"""The axis of frames ends at this multiple of the largest break-even number of frames."""


def finetuning_figures(summary: Summary, out: Path) -> list[Sketch]:
    """Curves by iterations, total times, and pictures; none unless rows differ in iterations of fine-tuning."""
    tuned = tunings(summary)
    if not tuned:
        return []
    return [*_progression(summary, tuned), *_crossover(summary, tuned), *_pictures(summary, out, tuned)]


def by_mode(tuned: list[Tuned]) -> dict[Mode, list[Tuned]]:
    """Rows by mode, fewest iterations first; modes without rows are absent."""
    modes = sorted({each.mode for each in tuned})
    return {mode: [each for each in tuned if each.mode == mode] for mode in modes}


def _progression(summary: Summary, tuned: list[Tuned]) -> list[Sketch]:
    columns = _measured(summary, tuned)
    if not columns:
        return []
    figure, grid = panels(len(columns), ACROSS, PANEL, below=0.4)
    for axes, column in zip(grid, columns, strict=True):
        _panel(axes, summary, column, tuned, lambda each: float(each.iterations))
        axes.set_xlabel("iterations of fine-tuning")
    figure.legend(handles=_handles(summary, tuned), loc="outside lower center", ncols=3, frameon=False)
    caption = (
        "Fine-tuning the surfels for a new light: metrics by iterations, means over"
        f" {mean_over(summary)}; dashed: without fine-tuning; bars: 95 % interval of the paired difference to that,"
        f" {population_of(summary)}."
    )
    return [Sketch("finetuning", caption, figure, on_page=True, images=True)]


def _measured(summary: Summary, tuned: list[Tuned]) -> list[ColumnSummary]:
    """Columns of relighting in which every row has a value."""
    cells = [summary["cells"][row] for row in (reference_of(summary), *(each.row for each in tuned))]
    relit = [column for column in summary["columns"] if column["key"].startswith(TASK)]
    return [column for column in relit if all(each[column["key"]]["mean"] is not None for each in cells)]


def _panel(
    axes: Axes, summary: Summary, column: ColumnSummary, tuned: list[Tuned], x_of: Callable[[Tuned], float]
) -> None:
    """A line per mode of a metric against ``x_of`` its rows, and a dashed line without fine-tuning."""

    def value(row: str) -> float:
        mean = summary["cells"][row][column["key"]]["mean"]
        assert mean is not None  # only such columns are drawn
        return mean

    for mode, mine in by_mode(tuned).items():
        differences = [summary["cells"][each.row][column["key"]]["difference"] for each in mine]
        bars = [0.0 if each is None or each["high"] is None else each["high"] - each["mean"] for each in differences]
        axes.errorbar(
            [x_of(each) for each in mine], [value(each.row) for each in mine], bars, color=mode.colour,
            marker="o", markersize=4, linewidth=1.0, elinewidth=0.6,
        )  # fmt: skip
    axes.axhline(value(reference_of(summary)), color="#000000", linestyle="--", linewidth=0.9, zorder=1)
    metric_over_numbers(axes, column)


def _handles(summary: Summary, tuned: list[Tuned]) -> list[Line2D]:
    texts = {row["key"]: plain(row["text"]) for row in summary["rows"]}
    handles = [Line2D([], [], color="#000000", linestyle="--", linewidth=0.9, label=texts[reference_of(summary)])]
    handles += [
        Line2D([], [], color=mode.colour, marker="o", markersize=4, linewidth=1.0, label=plain(mode.title))
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
    figure = blank(WIDE, 2.7 + 0.17 * (1 + max(map(len, by_mode(timed).values()))))
    axes, *others = figure.subplots(1, 1 + len(quality), squeeze=False).ravel()
    _totals(axes, timed, times, reference)
    for other, column in zip(others, quality, strict=True):
        _panel(other, summary, column, timed, lambda each: times[each.row].prepare)
        other.set_xlabel("seconds to prepare for a light")
    modes = by_mode(timed)
    versus = {each.row: times[each.row].versus(reference) for each in timed}
    columns = [_handles(summary, []), *(_timed_handles(mode, mine, versus) for mode, mine in modes.items())]
    rows = zip_longest(*columns, fillvalue=Line2D([], [], linestyle="", label=" "))  # shorter columns are filled up
    handles = [handle for column in zip(*rows, strict=True) for handle in column]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(columns), frameon=False)
    known = _modes_and_content(summary, reference_of(summary))
    assert known is not None  # else no row is fine-tuned
    untuned = flat(known[1]["variant"])[known[0]["field"]]
    caption = (
        "When fine-tuning pays: total seconds for a number of frames under one light, preparation included (times per"
        f" light and per frame are means over {mean_over(summary)}, on {summary['machine']}). Points: where a"
        f" fine-tuned row and {known[0]['titles'].get(untuned, untuned)} (dashed) break even."
    )
    if quality:
        caption += " Right: quality by preparation time; dashed: without fine-tuning."
    return [Sketch("finetuning-crossover", caption, figure, on_page=True)]


def _totals(axes: Axes, timed: list[Tuned], times: dict[str, RelightTimes], reference: RelightTimes) -> None:
    """Total seconds by frames, and the points where each row and the reference break even."""
    even = {each.row: times[each.row].break_even(reference) for each in timed}
    frames = np.geomspace(1, BEYOND * max([10.0, *(each for each in even.values() if each is not None)]), 200)
    axes.plot(frames, reference.after(frames), color="#000000", linestyle="--", linewidth=0.9)
    for mode, mine in by_mode(timed).items():
        for place, each in enumerate(mine):
            colour, after, crossing = mode.colour, times[each.row].after, even[each.row]
            axes.plot(frames, after(frames), color=colour, alpha=_alpha(place, mine), linewidth=1)
            if crossing is not None:
                axes.plot(crossing, after(np.array(crossing)), "o", color=colour, markersize=4)
    logarithmic(axes, "x", "y")
    axes.set(xlabel="frames under one light", title="total seconds ↓")
    add_grid(axes)


def _alpha(place: int, mine: list[Tuned]) -> float:
    """Opacity of a row's line: fewer iterations are paler."""
    return 0.25 + 0.75 * (place + 1) / len(mine)


def _timed_handles(mode: Mode, mine: list[Tuned], versus: dict[str, str]) -> list[Line2D]:
    """A column of the legend: the mode, then for which frames each of its rows is ahead."""
    lines = [
        Line2D([], [], color=mode.colour, alpha=_alpha(place, mine), linewidth=1,
               label=f"{each.text}: {versus[each.row]}")
        for place, each in enumerate(mine)
    ]  # fmt: skip
    return [Line2D([], [], linestyle="", label=plain(mode.title)), *lines]


def _pictures(summary: Summary, out: Path, tuned: list[Tuned]) -> list[Sketch]:
    """For each scene, one view: per mode by iterations, then without fine-tuning and the truth."""
    sketches = []
    for views in scene_views(summary, out):
        rows = [entry["row"] for entry in summary["sheet"] if entry["scene"] == views.scene]
        found = {row: part["relit"] for row, (_, part) in zip(rows, views.rows, strict=True) if "relit" in part}
        modes = {mode: mine for mode, mine in by_mode(tuned).items() if all(each.row in found for each in mine)}
        if "relit" in views.truth and reference_of(summary) in found and modes:
            sketches.append(_picture_grid(summary, views, found, modes))
    return sketches


def _picture_grid(
    summary: Summary, views: SceneViews, found: dict[str, Image], modes: dict[Mode, list[Tuned]]
) -> Sketch:
    reference = reference_of(summary)
    beside = [(row_texts(summary)[reference], found[reference]), ("truth", views.truth["relit"])]
    across = max(map(len, modes.values()))
    figure, grid = tiles(len(modes), 1, across + len(beside), 0.2)
    for line, (mode, mine) in zip(grid[:, 0], modes.items(), strict=True):
        for axes, each in zip(line, mine, strict=False):
            show(axes, found[each.row])
            axes.set_title(each.text)
        line[0].set_ylabel(wrapped(mode.title))
    for axes, (label, image) in zip(grid[0, 0, across:], beside, strict=True):
        show(axes, image)
        axes.set_title(wrapped(label))
    hide_empty(grid)
    light = f" under {views.light}" if views.light else ""
    caption = f"{views.scene}, view {views.view}{light}, after more and more iterations of fine-tuning for that light."
    return Sketch(file_name(views.scene, "finetuning"), caption, figure)


def tunings(summary: Summary) -> list[Tuned]:
    """Rows that differ from the reference row in mode and iterations of fine-tuning alone, sorted by both.

    Empty if the reference row is fine-tuned itself or its method offers no modes, or if no mode has two numbers of
    iterations.
    """
    known = None if summary["reference"] is None else _modes_and_content(summary, summary["reference"])
    if known is None:
        return []
    modes, base = known
    if flat(base["variant"]).get(modes["field"]) in (None, *modes["by_steps"]):
        return []
    found = []
    for row in summary["rows"]:
        content = made_from(summary, row["key"])
        if content is not None and _is_tuned_alone(content, base, modes):
            mode, iterations = flat(content["variant"]).get(modes["field"]), flat(content["budget"]).get(modes["steps"])
            if mode in modes["by_steps"] and iterations is not None:
                title = modes["titles"].get(mode, mode)
                found.append(Tuned(row["key"], Mode(modes["by_steps"].index(mode), title), iterations))
    kept = [each for each in found if sum(each.mode == other.mode for other in found) > 1]
    return sorted(kept, key=lambda each: (each.mode, each.iterations))


def _is_tuned_alone(content: dict[str, Any], base: dict[str, Any], modes: ModesSummary) -> bool:
    """Whether the content of a cell's key differs from another in its way of relighting alone."""
    if not {"variant", "budget"} <= content.keys() or any(content.get(part) != base.get(part) for part in SHARED):
        return False
    variant, budget = (changed_fields(content[part], base[part]) for part in ("variant", "budget"))
    return variant <= {modes["field"]} and budget <= {modes["steps"], "name"}


SHARED = ("method", "settings")


def times_of(summary: Summary, row: str) -> RelightTimes | None:
    """Mean times over the row's cells; None if not measured."""
    cells = summary["cells"][row]
    means = [cells[column]["mean"] for column in MILLISECONDS if column in cells]
    known = [1e-3 * each for each in means if each is not None]
    return RelightTimes(*known) if len(known) == len(MILLISECONDS) else None


def _modes_and_content(summary: Summary, row: str) -> tuple[ModesSummary, dict[str, Any]] | None:
    """The relighting modes of a row's method, and what its cells are made of; None for a method without modes."""
    content = made_from(summary, row) or {}
    modes = summary.get("relighting", {}).get(content.get("method", ""))
    return None if modes is None or not {"variant", "budget"} <= content.keys() else (modes, content)
