"""Tables of derived figures as texts with the numbers that they sort by, in Markdown and in LaTeX."""

from typing import NamedTuple

from ..analysis.paired import Estimate
from .latex import BOX_BEGIN, BOX_END, as_formula
from .plain import row_of, signed_figure

ROWS_A_PAGE = 32


class Item(NamedTuple):
    """A text in a grid, the number that it sorts by, and where there is none the reason."""

    text: str
    value: float | str | None = None
    reason: str = "not known"


class Grid(NamedTuple):
    """A table: ``note`` says how to read it, ``name`` names it in labels and on the page."""

    name: str
    title: str
    note: str
    heads: list[str]
    rows: list[list[Item]]


def grid_markdown(grid: Grid) -> list[str]:
    """The lines of the grid in Markdown, its title and note above."""
    lines = [f"## {grid.title}", "", grid.note, "", row_of(grid.heads), row_of(["---"] * len(grid.heads))]
    return [*lines, *(row_of([item.text for item in row]) for row in grid.rows)]


def grid_latex(grid: Grid) -> list[str]:
    """The grid in LaTeX, on as many pages as it needs."""
    pages = [grid.rows[start : start + ROWS_A_PAGE] for start in range(0, len(grid.rows), ROWS_A_PAGE)]
    first, *others = (grid._replace(rows=rows) for rows in pages)
    return [
        _table(first, f"{grid.title}. {grid.note}", f"\\label{{grid:{grid.name}}}"),
        *(_table(page, f"{grid.title}, continued.", "") for page in others),
    ]


def _table(grid: Grid, caption: str, label: str) -> str:
    lines = [
        r"\begin{table}[p]",
        r"\centering",
        f"\\caption{{{as_formula(caption)}}}{label}",
        BOX_BEGIN,
        f"\\begin{{tabular}}{{{'l' * len(grid.heads)}}}",
        r"\toprule",
        f"{' & '.join(map(as_formula, grid.heads))} \\\\",
        r"\midrule",
        *(f"{' & '.join(as_formula(item.text) for item in row)} \\\\" for row in grid.rows),
        r"\bottomrule",
        r"\end{tabular}}",
        BOX_END,
        r"\end{table}",
    ]
    return "\n".join(lines)


def spread(estimate: Estimate, digits: int, *, signed: bool) -> str:
    """Mean and half-width of the interval."""
    text = signed_figure(estimate.mean, digits) if signed else f"{estimate.mean:.{digits}f}"
    if estimate.low is None or estimate.high is None:
        return text
    return f"{text} ± {(estimate.high - estimate.low) / 2:.{digits}f}"


def factor(estimate: Estimate) -> str:
    """A ratio and the ends of its interval."""
    if estimate.low is None or estimate.high is None:
        return f"{estimate.mean:.2f}"
    return f"{estimate.mean:.2f} ({estimate.low:.2f} to {estimate.high:.2f})"
