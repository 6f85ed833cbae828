"""Findings of an analysis of a run as Markdown and LaTeX: sentences, then grids of derived values."""

from ..analysis.report import Grid, Report
from ..summary import Summary
from ..tables.caption import run_note
from .latex import as_formula, escape, tabular
from .markdown import table_head, table_line

ROWS_PER_PAGE = 32


def findings_markdown(summary: Summary, title: str, report: Report) -> str:
    """Sentences, then the tables."""
    lines = [f"# {summary['title']}: {title[0].lower()}{title[1:]}", "", *(f"- {each}" for each in report.sentences)]
    for grid in report.grids:
        lines += ["", *grid_markdown(grid)]
    return "\n".join([*lines, "", run_note(summary), ""])


def findings_latex(summary: Summary, title: str, report: Report) -> str:
    """Sentences, then the tables, to be input into a document with ``latex.PREAMBLE``."""
    lines = [
        f"% {as_formula(summary['title'])}: made by radiogs-bench from the results {', '.join(summary['keys'])}",
        rf"\section*{{{escape(title)}}}",
        r"\begin{itemize}",
        *(rf"\item {as_formula(sentence)}" for sentence in report.sentences),
        r"\end{itemize}",
        *(table for grid in report.grids for table in grid_latex(grid)),
    ]
    return "\n".join([*lines, ""])


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
    head, *lines = (
        rf"{' & '.join(map(as_formula, texts))} \\"
        for texts in (grid.heads, *([item.text for item in row] for row in grid.rows))
    )
    return "\n".join(
        [
            r"\begin{table}[tbp]",
            r"\centering",
            rf"\caption{{{as_formula(caption)}}}{label}",
            *tabular("l" * len(grid.heads), [head], lines),
            r"\end{table}",
        ]
    )
