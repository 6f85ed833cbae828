"""A table of the paper as Markdown and as CSV."""

import pandas as pd

from ...summary import PaperTable, PaperValue, Summary
from ..markdown import table_head, table_line
from ..notes import note_index
from ..records import difference_fields
from .layout import as_printed
from .reading import apart, caption, change, heading, is_beside, measured, row_label


def paper_markdown(table: PaperTable, summary: Summary) -> str:
    """A line of measured values for each row, and one of published values; reasons of missing ones in notes below.

    Published values by other conventions are a table of their own below.
    """
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
            lower.append(_published(value, notes) if is_beside(column) else "")
        lines.append(table_line([row_label(row), "measured", *upper]))
        if any(lower):
            lines.append(table_line([row["text"] if row.get("ran") else "", f"paper{_remark(row, notes)}", *lower]))
    lines += _apart(table, apart(table, summary), notes)
    numbered = [f"{place}. {note}" for place, note in enumerate(notes, start=1)]
    return "\n".join([*lines, "", below, "", *numbered, *([""] if numbered else [])])


def _apart(table: PaperTable, title: str, notes: list[str]) -> list[str]:
    """The table of published values by other conventions; empty without any."""
    columns = [column for column in table["columns"] if not is_beside(column)]
    if not columns:
        return []
    lines = ["", f"{title}:", "", *table_head(["", *map(heading, columns)])]
    for row in table["rows"]:
        values = [_published(table["cells"][row["key"]][column["key"]], notes) for column in columns]
        lines.append(table_line([f"{row['text']}{_remark(row, notes)}", *values]))
    return lines


def _published(value: PaperValue, notes: list[str]) -> str:
    return value["published"] or _missing(value["absent"] or "not published", notes)


def _remark(row: dict[str, str], notes: list[str]) -> str:
    return f" {_mark(row['remark'], notes)}" if row["remark"] else ""


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
                    "published_by": column.get("published_by"),
                    "ran": row.get("ran") or None,
                    "not_measured": value["reason"],
                    "not_published": value["absent"],
                }
            )
    return pd.DataFrame.from_records(records).to_csv(index=False)


def _missing(reason: str, notes: list[str]) -> str:
    return f"n/a {_mark(reason, notes)}"


def _mark(reason: str, notes: list[str]) -> str:
    return f"[{note_index(notes, reason) + 1}]"
