"""The suite's own table as LaTeX and Markdown, and its stored values as CSV."""

from ..summary import Summary
from ..tables.doubts import texts_of
from ..tables.model import PrintedCell, PrintedRow, Table
from .csv_text import csv_of, value_fields
from .latex import ARROWS, colour_of, escape, found_in, label_of, note_mark, text_below
from .markdown import listed, table_head, table_line
from .numbers import Entry, Group, TabularLine, difference_entry, environment, over


def suite_latex(table: Table) -> str:
    """The table environment, for documents that load booktabs, graphicx, siunitx and xcolor (option ``table``).

    Below each mean is its paired difference to the reference row with the half-width of the 95 % interval; beside it,
    in grey, the published value. A missing value is n/a, with its reason in a note; findings, footnotes of values, and
    remarks on methods follow the table as text.
    """
    groups = [_group(table, row) for row in table.rows]
    label = f"tab:{table.name}"
    lines = environment(table, label, _caption(table), "l", lambda part: _heads(table, part), groups)
    below = [*found_in(table.findings), *map(escape, (*table.footnotes, *table.remarks))]
    return "\n".join([*lines, *text_below(label, below), ""])


def _heads(table: Table, part: slice) -> list[str]:
    """Names of columns with the direction of better values, and their units."""
    names = [f"{escape(column.label)} {ARROWS.get(column.direction, '')}" for column in table.columns]
    units = [escape(column.unit) for column in table.columns]
    lines = ("Method", names), ("", units)
    return [rf"{' & '.join([label, *map(over, texts[part])])} \\" for label, texts in lines]


def _group(table: Table, row: PrintedRow) -> Group:
    """A line of means with published values behind them, and a line of differences with half-widths of intervals."""
    means = TabularLine(label_of(row.latex, row.text), [_mean(table, cell) for cell in row.cells])
    differences = TabularLine("", [difference_entry(cell.difference) for cell in row.cells])
    return Group([line for line in (means, differences) if any(line.entries)])


def _mean(table: Table, cell: PrintedCell) -> Entry:
    number = cell.text if cell.value is not None else f"{cell.text}{note_mark(table.note(cell.reason))}"
    beside = "" if cell.published is None else rf"\textcolor{{gray}}{{({cell.published.text})}}"
    return Entry(number, colour_of(cell.verdict), f"{escape(cell.marks)}{beside}")


def _caption(table: Table) -> str:
    differences = ""
    if table.reference is not None:
        reference = label_of(table.reference.latex, table.reference.text)
        differences = (
            f" Below each value: paired difference to {reference} and the half-width of its 95\\,\\% $t$ interval."
        )
    published = f" In grey: published ({escape(table.published_data)})." if table.published_columns else ""
    return f"{escape(table.caption)}{differences}{published}"


def suite_markdown(table: Table, note: str) -> str:
    """The findings, the means with paired differences, the published values, conditions (``note``) and remarks."""
    lines = [f"# {table.title}", "", *listed([each.plain for each in table.findings]), *means_markdown(table)]
    reference = None if table.reference is None else table.reference.text
    brackets = f"In brackets: paired difference to '{reference}', with its 95 % t interval. " if reference else ""
    below = [f"{brackets}{note}", *table.legend_in_words, *table.footnotes, *table.remarks]
    return "\n".join([*lines, *(line for paragraph in below for line in ("", paragraph)), ""])


def means_markdown(table: Table) -> list[str]:
    """The lines of the table: measured values with their paired differences, then the published values."""
    published = table.published_columns
    heads = [
        "",
        *(column.heading for column in table.columns),
        *(f"paper: {table.columns[place].heading}" for place in published),
    ]
    lines = table_head(heads)
    for row in table.rows:
        beside = [row.cells[place].published for place in published]
        printed = ["" if each is None else each.text for each in beside]
        lines.append(table_line([row.text, *map(_measured, row.cells), *printed]))
    return lines


def _measured(cell: PrintedCell) -> str:
    """The mean with the marks of its footnotes, and the paired difference with its interval and verdict."""
    if cell.value is None:
        return f"{cell.text} ({cell.reason})"
    difference = cell.difference
    if difference is None:
        return f"{cell.text}{cell.marks}"
    interval = f", {difference.low} to {difference.high}" if difference.low else ""
    verdict = f": {difference.verdict}" if difference.verdict else ""
    return f"{cell.text}{cell.marks} ({difference.text}{interval}{verdict})"


def suite_csv(summary: Summary) -> str:
    """One record per value: the mean and what it is over, its difference, interval, rank, published value, reason
    and doubt."""
    records = []
    for row in summary["rows"]:
        for column in summary["columns"]:
            cell = summary["cells"][row["key"]][column["key"]]
            published = summary["published"].get(row["key"], {}).get(column["key"])
            doubt = texts_of(summary, row["key"], column["key"]) or None
            fields = value_fields(summary, column, cell, published)
            records.append({"row": row["key"], **fields, "reason": cell["reason"], "doubt": doubt})
    return csv_of(records)
