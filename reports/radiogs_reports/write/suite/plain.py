"""The suite's table as Markdown and as CSV."""

import pandas as pd

from ...doubts import footnotes, marks, remarks, texts_of
from ...summary import CellSummary, ColumnSummary, Summary, row_texts
from ...summary import beside as published_beside
from ...wording import heading, signed
from ..caption import run_note
from ..markdown import table_head, table_line
from ..records import difference_fields


def suite_markdown(summary: Summary) -> str:
    """Measured values with their paired differences, then the published values in columns of their own."""
    published = [column for column in summary["columns"] if _is_published(summary, column)]
    heads = ["", *map(heading, summary["columns"]), *(f"paper: {heading(column)}" for column in published), "s"]
    lines = [f"# {summary['title']}", "", *table_head(heads)]
    for row in summary["rows"]:
        values = [
            measured(summary["cells"][row["key"]][c["key"]], c["decimals"], marks(summary, row["key"], c["key"]))
            for c in summary["columns"]
        ]
        beside = [
            f"{value:.{c['decimals']}f}" if (value := published_beside(summary, row["key"], c)) else ""
            for c in published
        ]
        seconds = "" if row["seconds"] is None else f"{row['seconds']:.0f}"
        lines.append(table_line([row["text"], *values, *beside, seconds]))
    below = [f"{_brackets(summary)}{run_note(summary)}", *footnotes(summary), *remarks(summary)]
    return "\n".join([*lines, *(line for paragraph in below for line in ("", paragraph)), ""])


def _brackets(summary: Summary) -> str:
    """What the brackets hold, as a sentence; empty without a reference row."""
    reference = summary["reference"]
    if reference is None:
        return ""
    return f"In brackets: paired difference to '{row_texts(summary)[reference]}', with its 95 % t interval. "


def measured(cell: CellSummary, decimals: int, mark: str = "") -> str:
    """The mean with the marks of its footnotes, and the paired difference with the ends of its interval."""
    if cell["mean"] is None:
        return f"n/a ({cell['reason']})"
    text = f"{cell['mean']:.{decimals}f}{mark}"
    difference = cell["difference"]
    if difference is None:
        return text
    if difference["low"] is None or difference["high"] is None:
        return f"{text} ({signed(difference['mean'], decimals)})"
    middle, low, high = (signed(end, decimals) for end in (difference["mean"], difference["low"], difference["high"]))
    return f"{text} ({middle}, {low} to {high})"


def suite_csv(summary: Summary) -> str:
    """One record per value: row, column, mean, count, difference, interval, published value, reason, doubt."""
    records = []
    for row in summary["rows"]:
        for column in summary["columns"]:
            cell = summary["cells"][row["key"]][column["key"]]
            records.append(
                {
                    "row": row["key"],
                    "column": column["key"],
                    "unit": column["unit"],
                    "direction": column["direction"],
                    "mean": cell["mean"],
                    "count": cell["count"],
                    **difference_fields(cell["difference"]),
                    "published": summary["published"].get(row["key"], {}).get(column["key"]),
                    "published_by": column.get("published_by"),
                    "reason": cell["reason"],
                    "doubt": texts_of(summary, row["key"], column["key"]) or None,
                }
            )
    return pd.DataFrame.from_records(records).to_csv(index=False)


def _is_published(summary: Summary, column: ColumnSummary) -> bool:
    return any(published_beside(summary, row["key"], column) is not None for row in summary["rows"])
