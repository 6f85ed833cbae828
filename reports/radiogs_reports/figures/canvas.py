"""Parts of all figures: style, sizes, tiles of pictures, and files with reproducible bytes."""

import hashlib
import math
import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib import rcParamsDefault
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy import object_
from numpy.typing import NDArray

from radiogs_core.own_files import fresh

from .. import maps
from ..wording import SYMBOL, mathematics

FOLDER = "figures"
DOTS_PER_INCH = 150

LONGEST_PART = 60
"""Characters of a scene's or method's name in the name of a file."""

STYLE: dict[Any, Any] = {
    **{name: value for name, value in rcParamsDefault.items() if name != "backend"},
    "font.family": "DejaVu Sans",  # comes with matplotlib, and has the Greek letters of the rows' names
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "pdf.fonttype": 42,  # outlines that journals accept, text that can be searched
}
"""All settings of matplotlib for every figure: its defaults instead of a ``matplotlibrc``, and ours over them."""

COLOURS = ("#0072b2", "#d55e00", "#00795a", "#a9487f", "#8a6d00", "#2f8fc4", "#5b4bb7", "#444444")
"""Colours of rows, in order: dark enough on white, distinct without red and green (after Okabe and Ito)."""

MARKERS = "osD^vPX*"

TILE = 1.25
"""Width and height of a picture in a grid, in inches."""

ALL = "all rows"
"""Label of a picture or curve that all rows share."""

CHARACTERS_PER_TILE = 20
"""Characters of a title that fit over a tile."""

LEGEND_LINE = 0.17
"""Inches that a line of a legend takes."""

INCHES_PER_CHARACTER = 0.065
"""Mean width of a legend's characters."""


@dataclass(frozen=True)
class Sketch:
    """A figure before it is saved."""

    name: str
    """File name without its ending."""
    caption: str
    """Plain text."""
    figure: Figure
    on_page: bool = False
    """Whether the page shows it; the page draws scatter plots and maps itself."""
    images: bool = False
    """Whether it shows images, whose colours the page keeps on a dark ground."""


@dataclass(frozen=True)
class Drawn:
    """A saved figure: its files, and the rest of its sketch."""

    png: Path
    pdf: Path
    caption: str
    on_page: bool = False
    images: bool = False


def blank(width: float, height: float) -> Figure:
    """An empty figure of a size in inches, outside matplotlib's global state."""
    figure = Figure(figsize=(width, height), dpi=DOTS_PER_INCH, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def panels(
    count: int, across: int, size: tuple[float, float], beside: float = 0.0, below: float = 0.0, **options: Any
) -> tuple[Figure, list[Axes]]:
    """A figure of so many panels of one size, line by line, and their axes.

    ``beside`` and ``below``: further inches of the figure's width and height, for labels and a legend. ``options``: of
    ``Figure.subplots``.
    """
    lines = max(1, math.ceil(count / across))
    figure = blank(size[0] * across + beside, size[1] * lines + below)
    grid = list(figure.subplots(lines, across, squeeze=False, **options).ravel())
    for axes in grid[count:]:
        axes.set_visible(False)
    return figure, grid[:count]


def tiles(bands: int, lines: int, across: int, room: float) -> tuple[Figure, NDArray[object_]]:
    """A figure of bands of pictures, each with ``room`` inches for its titles, and its axes, [bands, lines, across]."""
    figure = blank(TILE * across + 0.4, (TILE * lines + room) * bands)
    return figure, figure.subplots(lines * bands, across, squeeze=False).reshape(bands, lines, across)


MARKUP = re.compile(r"\\mathrm|[${}_^]")
"""Characters that ``plain``'s formulas do not show."""


def legend_columns(labels: Sequence[str], width: float, most: int) -> int:
    """The number of columns, as wide as the labels' longest line, that fit into ``width`` inches; at most ``most``."""
    longest = max(len(MARKUP.sub("", line)) for label in labels for line in label.split("\n"))
    return max(1, min(len(labels), most, int(width / (INCHES_PER_CHARACTER * longest + 0.5))))


def save(sketch: Sketch, out: Path) -> Drawn:
    """Write a figure as PNG and PDF, without the date and version that matplotlib would add."""
    png, pdf = (fresh(out / FOLDER / f"{sketch.name}.{ending}", out) for ending in ("png", "pdf"))
    sketch.figure.savefig(png, metadata={"Software": None})
    for image in sketch.figure.findobj(AxesImage):  # else magnified ones are stored as pixels of 1/150 inch
        image.set_interpolation("none")
    sketch.figure.savefig(pdf, metadata={"Creator": None, "Producer": None, "CreationDate": None})
    return Drawn(png, pdf, sketch.caption, sketch.on_page, sketch.images)


def file_name(*parts: str) -> str:
    """Join parts into a file name that every system and LaTeX accept; other parts give another name.

    A part has letters, digits and single underscores, and a digest of the whole part behind them if it has others.
    """
    names = []
    for part in parts:
        kept = re.sub(r"[^A-Za-z0-9]+", "_", part).strip("_")[:LONGEST_PART]
        digest = hashlib.sha256(part.encode("utf-8", "replace")).hexdigest()[:8]
        names.append(kept if kept and kept == part else f"{kept}_{digest}")
    return "-".join(names)


def plain(text: str) -> str:
    """Text for matplotlib: dollars, which would begin a formula, are escaped, and symbols such as L_G are formulas."""
    return SYMBOL.sub(lambda found: mathematics(*found.groups()), text.replace("$", r"\$"))


def wrapped(text: str, width: int = CHARACTERS_PER_TILE) -> str:
    """``plain`` in lines of so many characters, which fit over a tile."""
    return plain(textwrap.fill(text, width, break_long_words=False))


def show(axes: Axes, image: maps.Image) -> None:
    """Show a displayed map without ticks and frame; pixels stay sharp unless they must be made smaller."""
    axes.imshow(maps.levels(image), interpolation="auto")
    axes.set(xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set_visible(False)


def show_absence(axes: Axes, like: maps.Image) -> None:
    """Show an empty frame, shaped like another map, in place of a missing ground truth."""
    axes.set(xticks=[], yticks=[])
    axes.set_box_aspect(like.shape[0] / like.shape[1])
    axes.text(0.5, 0.5, "no ground\ntruth", transform=axes.transAxes, ha="center", va="center", color="#767676")
    for spine in axes.spines.values():
        spine.set(visible=True, linewidth=0.5, edgecolor="#bbbbbb")


def hide_empty(grid: NDArray[object_]) -> None:
    """Hide axes of a grid without data and text."""
    for axes in grid.ravel():
        axes.set_visible(axes.has_data() or bool(axes.texts))
