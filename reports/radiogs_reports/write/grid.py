"""Grids of derived values in Markdown and in LaTeX."""

from ..analysis.grid import Grid
from .latex import BOX_BEGIN, BOX_END, as_formula
from .markdown import table_head, table_line

ROWS_PER_PAGE = 32


def grid_markdown(grid: Grid) -> list[str]:
    """Title, note and table, as lines."""
    lines = [f"## {grid.title}", "", grid.note, "", *table_head(grid.heads)]
    return [*lines, *(table_line([item.text for item in row]) for row in grid.rows)]


def grid_latex(grid: Grid) -> list[str]:
    """Table environments, one per page that the grid needs."""
    pages = [grid.rows[start : start + ROWS_PER_PAGE] for start in range(0, len(grid.rows), ROWS_PER_PAGE)]
    first, *others = (grid._replace(rows=rows) for rows in pages)
    return [
        _table(first, f"{grid.title}. {grid.note}", f"\\label{{grid:{grid.name}}}"),
        *(_table(page, f"{grid.title}, continued.", "") for page in others),
    ]


def _table(grid: Grid, caption: str, label: str) -> str:
    lines = [
        r"\begin{table}[tbp]",
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
