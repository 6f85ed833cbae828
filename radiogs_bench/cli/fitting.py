"""A suite's table in the terminal: as many tables below each other as its width needs, so that no number is cut."""

from collections.abc import Sequence

from rich.cells import cell_len
from rich.markup import escape
from rich.table import Table

from radiogs_reports.doubts import marks
from radiogs_reports.summary import CellSummary, ColumnSummary, RowSummary, Summary, beside
from radiogs_reports.wording import ARROWS

LABEL = 24
"""Characters of a row's label before it is wrapped; nothing else is."""


Column = tuple[str, list[str]]
"""A heading, and an entry for each row."""


def tables_of(summary: Summary, width: int) -> list[Table]:
    """The suite's table, cut between columns where ``width`` characters do not hold it; seconds of training come last.

    A column that is too wide on its own is alone in its table.
    """
    label: Column = "", [row["text"] for row in summary["rows"]]
    columns = [*(column_of(summary, column) for column in summary["columns"]), seconds(summary)]
    tables = []
    room = width - drawn(min(LABEL, lines_of(label))) - 1
    while columns:
        count = next((n for n in range(len(columns), 1, -1) if needed(columns[:n]) <= room), 1)
        tables.append(table(label, columns[:count]))
        columns = columns[count:]
    tables[0].title = title(summary)
    return tables


def needed(columns: Sequence[Column]) -> int:
    """Characters that columns take when nothing is wrapped."""
    return sum(drawn(lines_of(column)) for column in columns)


def drawn(width: int) -> int:
    """Characters of a column with its margins and a line beside it."""
    return width + 3


def lines_of(column: Column) -> int:
    """The longest line of a column."""
    heading, entries = column
    return max(cell_len(line) for text in (heading, *entries) for line in text.split("\n"))


def title(summary: Summary) -> str:
    """What the table is, of which scenes and seeds."""
    seeds = ", ".join(map(str, summary["seeds"]))
    return f"{summary['title']}: {', '.join(summary['scenes'])}, seeds {seeds}, preset {summary['preset']}"


def table(label: Column, columns: Sequence[Column]) -> Table:
    """Some of the columns behind the rows' labels, which alone may be wrapped."""
    made = Table(show_lines=True)
    made.add_column(label[0], max_width=LABEL)
    for heading, _ in columns:
        made.add_column(heading, no_wrap=True, justify="right")
    for place, text in enumerate(label[1]):
        made.add_row(escape(text), *(entries[place] for _, entries in columns))
    return made


def seconds(summary: Summary) -> Column:
    """Mean seconds of training a cell; empty where nothing was trained."""
    return "training\n(s)", ["" if row["seconds"] is None else f"{row['seconds']:.1f}" for row in summary["rows"]]


def column_of(summary: Summary, column: ColumnSummary) -> Column:
    """A metric's heading and entries."""
    return heading(column), [entry_of(summary, row, column) for row in summary["rows"]]


def heading(column: ColumnSummary) -> str:
    """A column's label, a word or two a line, with the better direction and its unit."""
    task, _, measure = column["label"].partition(" ")
    unit = f"\n({column['unit']})" if column["unit"] else ""
    return f"{task}\n{measure} {ARROWS[column['direction']]}{unit}"


def entry_of(summary: Summary, row: RowSummary, column: ColumnSummary) -> str:
    """The entry of a row in a column."""
    cell = summary["cells"][row["key"]][column["key"]]
    return entry(cell, beside(summary, row["key"], column), column, marks(summary, row["key"], column["key"]))


def entry(cell: CellSummary, published: float | None, column: ColumnSummary, mark: str = "") -> str:
    """Mean with its marks, paired difference with its interval, and the published value, each on a line."""
    digits = column["decimals"]
    lines = ["n/a" if cell["mean"] is None else f"{cell['mean']:.{digits}f}{mark}"]
    difference = cell["difference"]
    if difference is not None and difference["low"] is not None and difference["high"] is not None:
        half_width = (difference["high"] - difference["low"]) / 2
        lines.append(f"{difference['mean']:+.{digits}f} ± {half_width:.{digits}f}")
    elif difference is not None:
        lines.append(f"{difference['mean']:+.{digits}f}")
    if published is not None:
        lines.append(f"paper {published:.{digits}f}")
    return "\n".join(lines)
