"""What all figures share: type, sizes, and files whose bytes depend on nothing but what is drawn."""

import re
import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from .. import maps

FOLDER = "figures"
DOTS_PER_INCH = 150

STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib, and has the Greek letters of the rows' names
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "pdf.fonttype": 42,  # outlines that journals accept, text that can be searched
}

COLOURS = ("#0072b2", "#d55e00", "#00795a", "#a9487f", "#8a6d00", "#2f8fc4", "#5b4bb7", "#444444")
"""For rows, in order; dark enough on white, told apart without red and green (after Okabe and Ito)."""

MARKERS = "osD^vPX*"

TILE = 1.25
"""Inches of a picture in a grid."""

ALL = "all rows"
"""The label of what is the same in all of them."""

LETTERS_ACROSS = 20
"""Of a name, in the type of titles, that are as wide as a tile."""


@dataclass(frozen=True)
class Sketch:
    """A figure that is still to be saved; ``name`` is its file's without ending, ``caption`` plain text."""

    name: str
    caption: str
    figure: Figure
    on_page: bool = False
    """Whether the page shows it: what it does not draw itself."""


@dataclass(frozen=True)
class Drawn:
    """A saved figure."""

    png: Path
    pdf: Path
    caption: str
    on_page: bool = False


def blank(width: float, height: float) -> Figure:
    """An empty figure of so many inches, apart from matplotlib's global state."""
    figure = Figure(figsize=(width, height), dpi=DOTS_PER_INCH, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(sketch: Sketch, out: Path) -> Drawn:
    """Write a figure as PNG and PDF, without the date and the version that matplotlib would put into them."""
    folder = out / FOLDER
    folder.mkdir(exist_ok=True)
    png, pdf = folder / f"{sketch.name}.png", folder / f"{sketch.name}.pdf"
    with rc_context(STYLE):
        sketch.figure.savefig(png, metadata={"Software": None})
        sketch.figure.savefig(pdf, metadata={"Creator": None, "Producer": None, "CreationDate": None})
    return Drawn(png, pdf, sketch.caption, sketch.on_page)


def file_name(*parts: str) -> str:
    """Parts of a name as one that every system and LaTeX take."""
    return "-".join(re.sub(r"[^A-Za-z0-9]+", "_", part).strip("_") or "_" for part in parts)


def plain(text: str) -> str:
    """Text that matplotlib prints as it is: a pair of dollars would otherwise be a formula."""
    return text.replace("$", r"\$")


def plain_numbers(axis: Axis) -> None:
    """Of a logarithmic axis: ticks at 1, 2, 5 of each decade, or a span below a decade would have one or none."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: number(value)))
    axis.set_minor_formatter(NullFormatter())


def number(value: float) -> str:
    """A tick's number in few letters: thousands as k, millions as M."""
    for unit, size in (("M", 1e6), ("k", 1e3)):
        if abs(value) >= size:
            return f"{value / size:g}{unit}"
    return f"{value:g}"


def wrapped(text: str) -> str:
    """A row's name in lines that fit over a tile."""
    return textwrap.fill(text, LETTERS_ACROSS, break_long_words=False)


def show(axes: Axes, image: maps.Image) -> None:
    """A displayed map, pixel by pixel, without axes."""
    axes.imshow(maps.levels(image), interpolation="nearest")
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)


def show_absence(axes: Axes, like: maps.Image) -> None:
    """A frame as large as another map's, where the data have no such map."""
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_box_aspect(like.shape[0] / like.shape[1])
    axes.text(0.5, 0.5, "no ground\ntruth", transform=axes.transAxes, ha="center", va="center", color="#767676")
    for spine in axes.spines.values():
        spine.set(visible=True, linewidth=0.5, edgecolor="#bbbbbb")


def hide_empty(grid: NDArray[np.object_]) -> None:
    """Leave no frame where a grid has nothing to show."""
    for axes in grid.ravel():
        axes.set_visible(axes.has_data() or bool(axes.texts))


def name_row(axes: Axes, text: str) -> None:
    """What a row of pictures shows, to its left."""
    axes.set_ylabel(text, fontsize=8)
