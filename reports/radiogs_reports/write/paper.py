"""A table of the paper as LaTeX and Markdown, measured beside published, and its stored values as CSV."""

from collections.abc import Sequence
from itertools import groupby

from ..summary import PaperTable, Summary
from ..tables.model import Column, PrintedCell, PrintedRow, Table
from ..tables.paper import apart_table
from .csv_text import csv_of, value_fields
from .latex import ARROWS, as_formula, colour_of, escape, found_in, note_mark, text_below
from .markdown import listed, table_head, table_line
from .numbers import Entry, Group, TabularLine, difference_entry, environment, over


def paper_latex(table: Table) -> str:
    """The table environment; documents must load booktabs, graphicx, amsmath, siunitx and xcolor (option ``table``).

    A row has a line of measured values, one of their differences to the reference row if it has any, and one of
    published values; values by other conventions follow below all rows. A missing value is n/a, with its reason in a
    note.
    """
    groups = [Group(_row_lines(table, row)) for row in table.rows]
    if table.apart_title:
        apart = [
            TabularLine(
                _paper_label(table, row.text, row.remark), [_published(table, each.apart) for each in row.cells]
            )
            for row in table.rows
        ]
        groups.append(Group(apart, f"{as_formula(table.apart_title)}:"))
    caption, label = as_formula(table.caption), f"measured:{table.name}"
    lines = environment(table, label, caption, "ll", lambda part: _heads(table.columns[part]), groups)
    return "\n".join([*lines, *text_below(label, found_in(table.findings)), ""])


def _heads(columns: Sequence[Column]) -> list[str]:
    """Headings that columns share, rules below them, and each column's own heading; a number takes two columns."""
    shared, rules, start = [], [], 3  # after the columns of the row's name and of "measured"
    for group, neighbours in groupby(columns, key=lambda each: each.group):
        width = 2 * len(list(neighbours))
        shared.append(rf"\multicolumn{{{width}}}{{c}}{{{escape(group)}}}")
        rules.append(rf"\cmidrule(lr){{{start}-{start + width - 1}}}")
        start += width
    return [
        rf" & & {' & '.join(shared)} \\",
        " ".join(rules),
        rf"Method & & {' & '.join(over(_heading(column)) for column in columns)} \\",
    ]


def _row_lines(table: Table, row: PrintedRow) -> list[TabularLine]:
    """Lines of measured values, of differences if there are any, and of published values if there are any."""
    measured = [Entry(_text(table, cell), colour_of(cell.verdict)) for cell in row.cells]
    differences = [difference_entry(cell.difference) for cell in row.cells]
    lines = [TabularLine(f"{as_formula(row.measured_label)} & measured", measured)]
    if any(differences):
        lines.append(TabularLine(r" & \scriptsize difference", differences))
    if row.has_published:
        published = [_published(table, cell.published) for cell in row.cells]
        lines.append(TabularLine(_paper_label(table, row.published_label, row.remark), published))
    return lines


def _paper_label(table: Table, label: str, remark: str) -> str:
    mark = note_mark(table.note(remark)) if remark else ""
    return rf"{as_formula(label)} & \textcolor{{darkgray}}{{paper}}{mark}"


def _published(table: Table, cell: PrintedCell | None) -> Entry:
    return Entry() if cell is None else Entry(_text(table, cell), r"\color{darkgray}")


def _text(table: Table, cell: PrintedCell) -> str:
    return cell.text if cell.value is not None else f"{cell.text}{note_mark(table.note(cell.reason))}"


def _heading(column: Column) -> str:
    unit = f" ({column.unit})" if column.unit not in ("", "dB", "deg") else ""
    arrow = f" {ARROWS[column.direction]}" if column.direction != "none" else ""
    return f"{as_formula(column.name + unit if column.name else column.unit)}{arrow}"


def paper_markdown(table: Table) -> str:
    """Lines of measured and published values by row; values by other conventions and reasons of n/a below."""
    lines = [f"# {table.title}", "", *listed([each.plain for each in table.findings])]
    lines += table_head(["", "", *(column.heading for column in table.columns)])
    for row in table.rows:
        lines.append(table_line([row.measured_label, "measured", *(_measured(table, cell) for cell in row.cells)]))
        if row.has_published:
            published = [_marked(table, cell.published) for cell in row.cells]
            lines.append(table_line([row.published_label, f"paper{_remark(table, row)}", *published]))
    notes = [f"{place}. {note}." for place, note in enumerate(table.notes, start=1)]
    paragraphs = [line for paragraph in (table.caption, *table.legend_in_words) for line in (paragraph, "")]
    return "\n".join([*lines, *_markdown_apart(table), "", *paragraphs, *notes, *([""] if notes else [])])


def _markdown_apart(table: Table) -> list[str]:
    """The table of published values by other conventions; empty without any."""
    if not table.apart_title:
        return []
    apart = apart_table(table)
    lines = ["", f"{apart.title}:", "", *table_head(["", *(column.heading for column in apart.columns)])]
    for row in apart.rows:
        values = [_marked(table, cell) for cell in row.cells]
        lines.append(table_line([f"{row.text}{_remark(table, row)}", *values]))
    return lines


def _measured(table: Table, cell: PrintedCell) -> str:
    """The mean, and the paired difference with its interval and verdict."""
    difference = cell.difference
    if cell.value is None or difference is None:
        return _marked(table, cell)
    verdict = f": {difference.verdict}" if difference.verdict else ""
    return f"{cell.text} ({difference.plus_minus}{verdict})"


def _marked(table: Table, cell: PrintedCell | None) -> str:
    """A value, or n/a with the number of its note; empty if the table has no value there."""
    if cell is None:
        return ""
    return cell.text if cell.value is not None else f"{cell.text} [{table.note(cell.reason) + 1}]"


def _remark(table: Table, row: PrintedRow) -> str:
    return f" [{table.note(row.remark) + 1}]" if row.remark else ""


def paper_csv(table: PaperTable, summary: Summary) -> str:
    """One record per value: row, column, mean and its units, count, difference, its interval, rank, published value,
    reasons."""
    records = []
    for row in table["rows"]:
        for column in table["columns"]:
            value = table["cells"][row["key"]][column["key"]]
            fields = value_fields(summary, column, value, value["published"])
            records.append(
                {
                    "table": table["key"],
                    "row": row["key"],
                    **fields,
                    "ran": row.get("ran") or None,
                    "not_measured": value["reason"],
                    "not_published": value["absent"],
                }
            )
    return csv_of(records)
