"""A table of the paper as Markdown and as CSV."""

import pandas as pd

from ...summary import PaperTable, Summary
from ..markdown import table_head, table_line
from ..notes import note_index
from ..records import difference_fields
from .layout import as_printed
from .reading import caption, change, heading, measured


def paper_markdown(table: PaperTable, summary: Summary) -> str:
    """A line of measured values and one of published values for each row; reasons of missing ones in notes below."""
    notes: list[str] = []
    below = caption(table, summary)
    table = as_printed(table)
    lines = [f"# {table['title']}", "", *table_head(["", "", *map(heading, table["columns"])])]
    for row in table["rows"]:
        upper, lower = [], []
        for column in table["columns"]:
            value = table["cells"][row["key"]][column["key"]]
            text, difference = measured(value, column), change(value, column, " ± ")
            beside = f" ({difference})" if difference else ""
            upper.append(f"{text}{beside}" if text else _missing(value["reason"] or "not measured", notes))
            lower.append(value["published"] or _missing(value["absent"] or "not published", notes))
        remark = f" {_mark(row['remark'], notes)}" if row["remark"] else ""
        lines += [table_line([row["text"], "measured", *upper]), table_line(["", f"paper{remark}", *lower])]
    numbered = [f"{place}. {note}" for place, note in enumerate(notes, start=1)]
    return "\n".join([*lines, "", below, "", *numbered, *([""] if numbered else [])])


def paper_csv(table: PaperTable) -> str:
    """One record per value: row, column, mean, count, difference, interval, published value, reasons."""
    records = []
    for row in table["rows"]:
        for column in table["columns"]:
            value = table["cells"][row["key"]][column["key"]]
            records.append(
                {
                    "table": table["key"],
                    "row": row["key"],
                    "column": column["key"],
                    "unit": column["unit"],
                    "direction": column["direction"],
                    "mean": value["mean"],
                    "count": value["count"],
                    **difference_fields(value["difference"]),
                    "published": value["published"],
                    "not_measured": value["reason"],
                    "not_published": value["absent"],
                }
            )
    return pd.DataFrame.from_records(records).to_csv(index=False)


def _missing(reason: str, notes: list[str]) -> str:
    return f"n/a {_mark(reason, notes)}"


def _mark(reason: str, notes: list[str]) -> str:
    return f"[{note_index(notes, reason) + 1}]"
