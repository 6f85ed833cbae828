"""A table of the paper as Markdown and as CSV."""

import pandas as pd

from ...summary import PaperColumn, PaperTable, Summary
from ..plain import ARROWS, row_of
from .layout import as_printed
from .reading import caption, change, measured


def heading(column: PaperColumn) -> str:
    """The column's headings on one line, with the better direction."""
    arrow = f" {ARROWS[column['direction']]}" if column["direction"] != "none" else ""
    unit = f" ({column['unit']})" if column["unit"] else ""
    return f"{column['group']} {column['label']}".strip() + arrow + unit


def paper_markdown(table: PaperTable, summary: Summary) -> str:
    """A line of measured figures and one of the paper's for each row; reasons of what is lacking in notes below."""
    notes: list[str] = []
    below = caption(table, summary)
    table = as_printed(table)
    lines = [
        f"# {table['title']}", "", row_of(["", "", *map(heading, table["columns"])]),
        row_of(["---"] * (2 + len(table["columns"]))),
    ]  # fmt: skip
    for row in table["rows"]:
        upper, lower = [], []
        for column in table["columns"]:
            figure = table["cells"][row["key"]][column["key"]]
            text, difference = measured(figure, column), change(figure, column, " ± ")
            beside = f" ({difference})" if difference else ""
            upper.append(f"{text}{beside}" if text else _missing(figure["reason"] or "not measured", notes))
            lower.append(figure["published"] or _missing(figure["absent"] or "not published", notes))
        remark = f" {_noted(row['remark'], notes)}" if row["remark"] else ""
        lines += [row_of([row["text"], "measured", *upper]), row_of(["", f"paper{remark}", *lower])]
    noted = [f"{place}. {note}" for place, note in enumerate(notes, start=1)]
    return "\n".join([*lines, "", below, "", *noted, *([""] if noted else [])])


def paper_csv(table: PaperTable) -> str:
    """One line a figure: row, column, mean, count, difference, interval, published figure, reasons."""
    records = []
    for row in table["rows"]:
        for column in table["columns"]:
            figure = table["cells"][row["key"]][column["key"]]
            difference = figure["difference"] or {"mean": None, "low": None, "high": None}
            records.append(
                {
                    "table": table["key"],
                    "row": row["key"],
                    "column": column["key"],
                    "unit": column["unit"],
                    "direction": column["direction"],
                    "mean": figure["mean"],
                    "count": figure["count"],
                    "difference": difference["mean"],
                    "difference_low": difference["low"],
                    "difference_high": difference["high"],
                    "published": figure["published"],
                    "not_measured": figure["reason"],
                    "not_published": figure["absent"],
                }
            )
    return pd.DataFrame.from_records(records).to_csv(index=False)


def _missing(reason: str, notes: list[str]) -> str:
    return f"n/a {_noted(reason, notes)}"


def _noted(reason: str, notes: list[str]) -> str:
    if reason not in notes:
        notes.append(reason)
    return f"[{notes.index(reason) + 1}]"
