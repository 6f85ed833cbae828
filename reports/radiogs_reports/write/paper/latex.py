"""A table of the paper in LaTeX: booktabs, the paper's rank colours, published values below the measured ones."""

from ...summary import PaperColumn, PaperTable, PaperValue, Summary
from ..latex import ARROWS, BOX_BEGIN, BOX_END, as_formula, escape, note_mark, rank_colour
from ..notes import note_index
from .layout import as_printed
from .reading import apart, caption, change, groups, is_beside, measured, measured_ranks, published_ranks, row_label

Ranks = dict[str, dict[str, int]]
"""By column, then row."""


def paper_latex(table: PaperTable, summary: Summary) -> str:
    """The table environment, for documents that load booktabs, graphicx, amsmath and xcolor (option ``table``).

    A row has a line of measured values, one of their differences to the reference row if it has any, and one of
    published values; those by other conventions are below all rows. A value that does not exist is n/a, with its reason
    in a note.
    """
    notes: list[str] = []
    below = as_formula(caption(table, summary))
    table = as_printed(table)
    columns = table["columns"]
    lines = [
        f"% {escape(table['key'])}: made by radiogs-bench; the paper's {escape(table['label'])}",
        r"\begin{table}[p]",
        r"\centering",
        f"\\caption{{{below}}}",
        f"\\label{{measured:{table['key']}}}",
        BOX_BEGIN,
        f"\\begin{{tabular}}{{ll{'c' * len(columns)}}}",
        r"\toprule",
        " & & " + " & ".join(_spanning(group, count) for group, count in groups(table)) + r" \\",
        " ".join(_rule(start, end) for start, end in _spans(table)),
        "Method & & " + " & ".join(_heading(column) for column in columns) + r" \\",
        r"\midrule",
    ]
    ranks = [
        {column["key"]: ranks_of(table, column) for column in columns} for ranks_of in (measured_ranks, published_ranks)
    ]
    for place, row in enumerate(table["rows"]):
        lines += [r"\addlinespace"] * (place > 0) + _row_lines(table, row, ranks, notes)
    lines += _apart(table, apart(table, summary), ranks[1], notes)
    lines += [r"\bottomrule", r"\end{tabular}}", BOX_END]
    lines += [
        rf"\par\smallskip\footnotesize {note_mark(index)} {as_formula(note)}." for index, note in enumerate(notes)
    ]
    return "\n".join([*lines, r"\end{table}", ""])


def _row_lines(table: PaperTable, row: dict[str, str], ranks: list[Ranks], notes: list[str]) -> list[str]:
    """Lines of measured values, of differences if there are any, and of published values."""
    upper, middle, lower = [], [], []
    of_measured, of_published = ranks
    for column in table["columns"]:
        value = table["cells"][row["key"]][column["key"]]
        text = measured(value, column)
        colour = rank_colour(of_measured[column["key"]].get(row["key"]))
        upper.append(f"{colour}{text}" if text else _missing(value["reason"] or "not measured", notes))
        difference = change(value, column, r" \pm ")
        middle.append(rf"\scriptsize ${difference}$" if difference else "")
        lower.append(_published(value, of_published[column["key"]].get(row["key"]), notes) if is_beside(column) else "")
    remark = _mark(row["remark"], notes) if row["remark"] else ""
    lines = [f"{as_formula(row_label(row))} & measured & {' & '.join(upper)} \\\\"]
    if any(middle):
        lines.append(f" & \\scriptsize difference & {' & '.join(middle)} \\\\")
    if any(lower):
        label = as_formula(row["text"]) if row.get("ran") else ""
        lines.append(rf"{label} & \textcolor{{darkgray}}{{paper}}{remark} & {' & '.join(lower)} \\")
    return lines


def _apart(table: PaperTable, title: str, ranks: Ranks, notes: list[str]) -> list[str]:
    """Lines of published values by other conventions, below a rule and their heading; none without any."""
    if not title:
        return []
    lines = [r"\midrule", rf"\multicolumn{{{2 + len(table['columns'])}}}{{l}}{{{as_formula(title)}:}} \\"]
    for row in table["rows"]:
        values = [
            "" if is_beside(column)
            else _published(table["cells"][row["key"]][column["key"]], ranks[column["key"]].get(row["key"]), notes)
            for column in table["columns"]
        ]  # fmt: skip
        remark = _mark(row["remark"], notes) if row["remark"] else ""
        lines.append(rf"{as_formula(row['text'])} & \textcolor{{darkgray}}{{paper}}{remark} & {' & '.join(values)} \\")
    return lines


def _published(value: PaperValue, rank: int | None, notes: list[str]) -> str:
    printed = (value["published"] or "").replace("-", "$-$")
    text = printed or _missing(value["absent"] or "not published", notes)
    return rf"{rank_colour(rank)}\textcolor{{darkgray}}{{{text}}}"


def _missing(reason: str, notes: list[str]) -> str:
    return f"n/a{_mark(reason, notes)}"


def _mark(reason: str, notes: list[str]) -> str:
    return note_mark(note_index(notes, reason.rstrip(".")))


def _heading(column: PaperColumn) -> str:
    unit = f" ({column['unit']})" if column["unit"] not in ("", "dB", "deg") else ""
    arrow = f" {ARROWS[column['direction']]}" if column["direction"] != "none" else ""
    return f"{as_formula(column['label'] + unit if column['label'] else column['unit'])}{arrow}"


def _spanning(group: str, count: int) -> str:
    return rf"\multicolumn{{{count}}}{{c}}{{{escape(group)}}}"


def _spans(table: PaperTable) -> list[tuple[int, int]]:
    """First and last column that each group spans, counted from 1."""
    spans, start = [], 3  # after the columns of the row's name and of "measured"
    for _, count in groups(table):
        spans.append((start, start + count - 1))
        start += count
    return spans


def _rule(start: int, end: int) -> str:
    return rf"\cmidrule(lr){{{start}-{end}}}"
