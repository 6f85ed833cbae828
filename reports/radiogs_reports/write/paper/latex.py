"""A table of the paper in LaTeX: booktabs, the paper's rank colours, measured and published line below line."""

from ...summary import PaperColumn, PaperTable, Summary
from ..latex import ARROWS, BOX_BEGIN, BOX_END, RANK_COLOURS, as_formula, escape, note_mark
from .layout import as_printed
from .reading import caption, change, groups, measured, ranks


def paper_latex(table: PaperTable, summary: Summary) -> str:
    """The table environment, to be included where booktabs, graphicx, amsmath and xcolor (``table``) are loaded.

    A row has a line of measured figures, one of their differences to the reference row if it has any, and one of the
    paper's. A figure that does not exist is n/a with its reason in a note.
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
    for place, row in enumerate(table["rows"]):
        lines += [r"\addlinespace"] * (place > 0) + _lines_of(table, row, notes)
    lines += [
        r"\bottomrule",
        r"\end{tabular}}",
        BOX_END,
    ]
    lines += [
        rf"\par\smallskip\footnotesize {note_mark(place)} {as_formula(note)}." for place, note in enumerate(notes)
    ]
    return "\n".join([*lines, r"\end{table}", ""])


def _lines_of(table: PaperTable, row: dict[str, str], notes: list[str]) -> list[str]:
    upper, middle, lower = [], [], []
    for column in table["columns"]:
        figure = table["cells"][row["key"]][column["key"]]
        text = measured(figure, column)
        mine = ranks(table, column, of_published=False).get(row["key"])
        theirs = ranks(table, column, of_published=True).get(row["key"])
        upper.append(f"{_colour(mine)}{text}" if text else _missing(figure["reason"] or "not measured", notes))
        difference = change(figure, column, r" \pm ")
        middle.append(rf"\scriptsize ${difference}$" if difference else "")
        printed = (figure["published"] or "").replace("-", "$-$")
        published = printed or _missing(figure["absent"] or "not published", notes)
        lower.append(rf"{_colour(theirs)}\textcolor{{darkgray}}{{{published}}}")
    label = as_formula(row["text"])
    remark = _noted(row["remark"], notes) if row["remark"] else ""
    lines = [f"{label} & measured & {' & '.join(upper)} \\\\"]
    if any(middle):
        lines.append(f" & \\scriptsize difference & {' & '.join(middle)} \\\\")
    return [*lines, rf" & \textcolor{{darkgray}}{{paper}}{remark} & {' & '.join(lower)} \\"]


def _missing(reason: str, notes: list[str]) -> str:
    return f"n/a{_noted(reason, notes)}"


def _noted(reason: str, notes: list[str]) -> str:
    reason = reason.rstrip(".")
    if reason not in notes:
        notes.append(reason)
    return note_mark(notes.index(reason))


def _colour(rank: int | None) -> str:
    return "" if rank is None else rf"\cellcolor[HTML]{{{RANK_COLOURS[rank]}}}"


def _heading(column: PaperColumn) -> str:
    unit = f" ({column['unit']})" if column["unit"] not in ("", "dB", "deg") else ""
    arrow = f" {ARROWS[column['direction']]}" if column["direction"] != "none" else ""
    return f"{as_formula(column['label'] + unit if column['label'] else column['unit'])}{arrow}"


def _spanning(group: str, count: int) -> str:
    return rf"\multicolumn{{{count}}}{{c}}{{{escape(group)}}}"


def _spans(table: PaperTable) -> list[tuple[int, int]]:
    spans, start = [], 3  # two columns stand before the figures
    for _, count in groups(table):
        spans.append((start, start + count - 1))
        start += count
    return spans


def _rule(start: int, end: int) -> str:
    return rf"\cmidrule(lr){{{start}-{end}}}"
