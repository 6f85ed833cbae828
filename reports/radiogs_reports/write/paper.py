"""A table of the paper with its own rows and columns, measured beside published: LaTeX, Markdown and CSV."""

import pandas as pd

from ..analysis.legend import paper_legend, verdict_of, without_marked
from ..summary import PaperColumn, PaperTable, PaperValue, Summary
from .latex import ARROWS, LEFT, as_formula, colour_of, escape, legend, note_mark
from .markdown import table_head, table_line
from .notes import note_index
from .numbers import SETUP, Entry, Group, Line, over, tabulars
from .paper_layout import as_printed
from .paper_reading import (
    apart,
    caption,
    change,
    groups_of,
    heading,
    is_beside,
    measured,
    row_label,
)
from .records import difference_fields

PLUS_MINUS = "±"


def paper_latex(table: PaperTable, summary: Summary) -> str:
    """The table environment; documents must load booktabs, graphicx, amsmath, siunitx and xcolor (option ``table``).

    A row has a line of measured values, one of their differences to the reference row if it has any, and one of
    published values; those by other conventions are below all rows. A value that does not exist is n/a, with its reason
    in a note.
    """
    notes: list[str] = []
    below = as_formula(caption(table, summary))
    sentences = paper_legend(table, summary)
    table = as_printed(without_marked(table, summary))
    groups = [Group(_row_lines(table, row, notes)) for row in table["rows"]]
    title = apart(table, summary)
    if title:
        groups.append(Group(_apart(table, notes), f"{as_formula(title)}:"))
    lines = [
        f"% {escape(table['key'])}: made by radiogs-bench; the paper's {escape(table['label'])}",
        r"\begin{table}[tbp]",
        r"\centering",
        SETUP,
        f"\\caption{{{below}}}",
        f"\\label{{measured:{table['key']}}}",
        *tabulars("ll", f"measured:{table['key']}", lambda part: _heads(table["columns"][part]), groups),
        LEFT,
    ]
    lines += [
        rf"\par\smallskip\footnotesize {note_mark(index)} {as_formula(note)}." for index, note in enumerate(notes)
    ]
    return "\n".join([*lines, *legend(sentences), r"\end{table}", ""])


def _heads(columns: list[PaperColumn]) -> list[str]:
    """What columns share, rules below it, and each column's own heading."""
    return [
        " & & " + " & ".join(_spanning(group, count) for group, count in groups_of(columns)) + r" \\",
        " ".join(_rule(start, end) for start, end in _spans(columns)),
        "Method & & " + " & ".join(over(_heading(column)) for column in columns) + r" \\",
    ]


def _row_lines(table: PaperTable, row: dict[str, str], notes: list[str]) -> list[Line]:
    """Lines of measured values, of differences if there are any, and of published values."""
    upper, middle, lower = [], [], []
    for column in table["columns"]:
        value = table["cells"][row["key"]][column["key"]]
        text = measured(value, column)
        colour = colour_of(verdict_of(value))
        upper.append(Entry(text, colour) if text else Entry(_missing(value["reason"] or "not measured", notes)))
        middle.append(_difference(value, column))
        lower.append(_published(value, notes) if is_beside(column) else Entry())
    lines = [Line(f"{as_formula(row_label(row))} & measured", upper)]
    if any(middle):
        lines.append(Line(r" & \scriptsize difference", middle))
    if any(lower):
        lines.append(Line(_paper_label(row["text"] if row.get("ran") else "", row, notes), lower))
    return lines


def _apart(table: PaperTable, notes: list[str]) -> list[Line]:
    """Lines of published values by other conventions."""
    lines = []
    for row in table["rows"]:
        values = [
            Entry() if is_beside(column) else _published(table["cells"][row["key"]][column["key"]], notes)
            for column in table["columns"]
        ]  # fmt: skip
        lines.append(Line(_paper_label(row["text"], row, notes), values))
    return lines


def _paper_label(text: str, row: dict[str, str], notes: list[str]) -> str:
    remark = _mark(row["remark"], notes) if row["remark"] else ""
    return rf"{as_formula(text)} & \textcolor{{darkgray}}{{paper}}{remark}"


def _difference(value: PaperValue, column: PaperColumn) -> Entry:
    number, sign, half_width = change(value, column, PLUS_MINUS).partition(PLUS_MINUS)
    return Entry(number, r"\scriptsize ", rf"\scriptsize $\pm${half_width}" if sign else "") if number else Entry()


def _published(value: PaperValue, notes: list[str]) -> Entry:
    text = value["published"] or _missing(value["absent"] or "not published", notes)
    return Entry(text, r"\color{darkgray}")


def _missing(reason: str, notes: list[str]) -> str:
    return f"n/a{_mark(reason, notes)}"


def _mark(reason: str, notes: list[str]) -> str:
    return note_mark(note_index(notes, reason.rstrip(".")))


def _heading(column: PaperColumn) -> str:
    unit = f" ({column['unit']})" if column["unit"] not in ("", "dB", "deg") else ""
    arrow = f" {ARROWS[column['direction']]}" if column["direction"] != "none" else ""
    return f"{as_formula(column['label'] + unit if column['label'] else column['unit'])}{arrow}"


def _spanning(group: str, count: int) -> str:
    return rf"\multicolumn{{{2 * count}}}{{c}}{{{escape(group)}}}"


def _spans(columns: list[PaperColumn]) -> list[tuple[int, int]]:
    """First and last column of the tabular, two for a number, that each group spans, counted from 1."""
    spans, start = [], 3  # after the columns of the row's name and of "measured"
    for _, count in groups_of(columns):
        spans.append((start, start + 2 * count - 1))
        start += 2 * count
    return spans


def _rule(start: int, end: int) -> str:
    return rf"\cmidrule(lr){{{start}-{end}}}"


def paper_markdown(table: PaperTable, summary: Summary) -> str:
    """A line of measured values for each row, and one of published values; reasons of missing ones in notes below.

    Published values by other conventions are a table of their own below.
    """
    notes: list[str] = []
    below = [caption(table, summary), *paper_legend(table, summary, coloured=False)]
    table = as_printed(without_marked(table, summary))
    lines = [f"# {table['title']}", "", *table_head(["", "", *map(heading, table["columns"])])]
    for row in table["rows"]:
        upper, lower = [], []
        for column in table["columns"]:
            value = table["cells"][row["key"]][column["key"]]
            text, difference = measured(value, column), change(value, column, " ± ")
            verdict = verdict_of(value)
            beside = f" ({difference}{'' if verdict is None else f': {verdict}'})" if difference else ""
            upper.append(f"{text}{beside}" if text else _markdown_missing(value["reason"] or "not measured", notes))
            lower.append(_markdown_published(value, notes) if is_beside(column) else "")
        lines.append(table_line([row_label(row), "measured", *upper]))
        if any(lower):
            lines.append(table_line([row["text"] if row.get("ran") else "", f"paper{_remark(row, notes)}", *lower]))
    lines += _markdown_apart(table, apart(table, summary), notes)
    numbered = [f"{place}. {note}" for place, note in enumerate(notes, start=1)]
    paragraphs = [line for paragraph in below for line in (paragraph, "")]
    return "\n".join([*lines, "", *paragraphs, *numbered, *([""] if numbered else [])])


def _markdown_apart(table: PaperTable, title: str, notes: list[str]) -> list[str]:
    """The table of published values by other conventions; empty without any."""
    columns = [column for column in table["columns"] if not is_beside(column)]
    if not columns:
        return []
    lines = ["", f"{title}:", "", *table_head(["", *map(heading, columns)])]
    for row in table["rows"]:
        values = [_markdown_published(table["cells"][row["key"]][column["key"]], notes) for column in columns]
        lines.append(table_line([f"{row['text']}{_remark(row, notes)}", *values]))
    return lines


def _markdown_published(value: PaperValue, notes: list[str]) -> str:
    return value["published"] or _markdown_missing(value["absent"] or "not published", notes)


def _remark(row: dict[str, str], notes: list[str]) -> str:
    return f" {_markdown_mark(row['remark'], notes)}" if row["remark"] else ""


def _markdown_missing(reason: str, notes: list[str]) -> str:
    return f"n/a {_markdown_mark(reason, notes)}"


def _markdown_mark(reason: str, notes: list[str]) -> str:
    return f"[{note_index(notes, reason) + 1}]"


def paper_csv(table: PaperTable) -> str:
    """One record per value: row, column, mean, count, difference, its interval, rank, published value, reasons."""
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
                    "rank": value.get("rank"),
                    "smallest_resolved": column.get("smallest"),
                    "published": value["published"],
                    "published_by": column.get("published_by"),
                    "ran": row.get("ran") or None,
                    "not_measured": value["reason"],
                    "not_published": value["absent"],
                }
            )
    return pd.DataFrame.from_records(records).to_csv(index=False)
