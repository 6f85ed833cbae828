"""Bars of the oracle ladder: the value of each part first in and last out, a panel for each metric."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.patches import Patch

from ..analysis.ladder import ALL_SCENES, ENDS, Rung, is_own, ladder_rungs
from ..summary import Summary
from ..wording import label_with_unit, signed
from .axes import add_grid
from .canvas import COLOURS, Sketch, file_name, panels, plain

ACROSS = 4
PANEL = (2.1, 2.0)
LEGEND = 0.3
"""Height of the legend in inches."""

THICKNESS = 0.38
"""Thickness of a bar, as a share of the distance between two parts."""

ROOM = 1.25
"""Length of an axis, as a multiple of the largest bar that it has to show whole."""

OWN_SHARE = 0.1
"""Smallest share of the bar of a metric's own part that the axis shows."""


def ladder_figures(summary: Summary) -> list[Sketch]:
    """A figure for each method and scene, and one over all scenes, which the page shows where there are several."""
    rungs = ladder_rungs(summary)
    whole = ALL_SCENES if len(summary["scenes"]) > 1 else None
    places = dict.fromkeys((rung.method, rung.scene) for rung in rungs)
    several = len({method for method, _ in places}) > 1
    sketches = []
    for method, scene in places:
        over = ("all", "scenes") if scene == ALL_SCENES else (scene,)  # a name that no scene's figure has
        name = file_name("ladder", *([method] if several else []), *over)
        title = f"{method} on {scene}" if several else f"On {scene}"
        mine = [rung for rung in rungs if (rung.method, rung.scene) == (method, scene)]
        sketches.append(_sketch(name, title, mine, on_page=whole in (None, scene)))
    return sketches


def _sketch(name: str, title: str, rungs: Sequence[Rung], on_page: bool) -> Sketch:
    figure, grid = panels(len(rungs), min(ACROSS, len(rungs)), PANEL, beside=0.6, below=LEGEND, sharey=True)
    for axes, rung in zip(grid, rungs, strict=True):
        _panel(axes, rung)
    handles = [Patch(color=colour, label=end) for end, colour in zip(ENDS, COLOURS, strict=False)]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(ENDS), frameon=False)
    caption = (
        f"{title}: what each part of the truth is worth when it alone is given (first in, compared with nothing given),"
        " and when it alone is left out (last out, compared with everything given). To the right is better, whatever"
        " the metric's direction; bars: 95 % t interval over seeds, or over scenes. Pale: the metric measures the part"
        " itself, which for the other parts is never given. Bars that are cut off have their value on them."
    )
    return Sketch(name, caption, figure, on_page=on_page)


def _panel(axes: Axes, rung: Rung) -> None:
    """Two bars for each part, from top to bottom; the axis holds whole bars, and a tenth or more of the part's own."""
    decimals, parts = rung.column["decimals"], list(rung.parts)
    ends = [(part, end) for part, share in rung.parts.items() for end in share if end is not None]
    values = [(part, each) for part, end in ends for each in (end.mean, end.low, end.high) if each is not None]
    seen = [abs(value) * (OWN_SHARE if is_own(part, rung.column) else 1.0) for part, value in values]
    reach = ROOM * max(seen, default=0.0) or 1.0
    least = min([0.0, *(value for _, value in values)])
    for place, part in enumerate(parts):
        own = is_own(part, rung.column)
        for number, end in enumerate(rung.parts[part]):
            if end is None:
                continue
            height = place + (number - 0.5) * THICKNESS
            axes.barh(height, end.mean, THICKNESS, color=COLOURS[number], alpha=0.35 if own else 1.0)
            if end.low is not None and end.high is not None:
                axes.plot([end.low, end.high], [height, height], color="#222222", linewidth=0.8)
            if abs(end.mean) > reach:
                side = 1 if end.mean > 0 else -1
                axes.text(
                    0.97 * side * reach, height, signed(end.mean, decimals), fontsize=6, va="center",
                    ha="right" if side > 0 else "left",
                )  # fmt: skip
    axes.set_xlim(max(-reach, ROOM * least - 0.08 * reach), reach)
    axes.axvline(0, color="#888888", linewidth=0.8)
    axes.set_yticks(range(len(parts)), parts)
    axes.set_ylim(len(parts) - 0.5, -0.5)
    axes.set_title(plain(label_with_unit(rung.column)))
    add_grid(axes, "x")
