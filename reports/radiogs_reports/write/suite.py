"""The suite's own table, means, paired differences and published values: LaTeX, Markdown and CSV."""

import pandas as pd

from ..analysis.legend import shown_verdict, suite_legend
from ..doubts import footnotes, marks, remarks, texts_of
from ..summary import CellSummary, ColumnSummary, RowSummary, Summary, Verdict, half_width, row_texts
from ..summary import beside as published_beside
from ..wording import heading, signed
from .caption import run_note, unfinished
from .latex import ARROWS, END, LEFT, PREAMBLE, colour_of, escape, legend, note_mark, row_label
from .markdown import table_head, table_line
from .notes import note_index
from .numbers import SETUP, Entry, Group, Line, over, tabulars
from .records import difference_fields


def suite_document(summary: Summary) -> str:
    """A document of its own around ``suite_latex``, which pdflatex compiles."""
    return f"{PREAMBLE}{suite_latex(summary)}{END}"


def suite_latex(summary: Summary) -> str:
    """The table environment, for documents that load booktabs, graphicx, siunitx and xcolor (option ``table``).

    Under each mean stands its paired difference to the reference row with the half-width of the 95 % interval; beside
    it, in grey, the published value. A value that does not exist is n/a, with its reason in a note; what else there is
    to be said of values and methods follows the table as text.
    """
    notes: list[str] = []
    groups = [_group(summary, row, notes) for row in summary["rows"]]
    lines = [
        f"% {escape(summary['suite'])}: made by radiogs-bench from the results {', '.join(summary['keys'])}",
        r"\begin{table}[tbp]",
        r"\centering",
        SETUP,
        f"\\caption{{{_caption(summary)}}}",
        f"\\label{{tab:{summary['suite']}}}",
        *tabulars("l", f"tab:{summary['suite']}", lambda part: _heads(summary, part), groups),
        LEFT,
    ]
    lines += [rf"\par\smallskip\footnotesize {note_mark(index)} {escape(note)}" for index, note in enumerate(notes)]
    lines += legend(suite_legend(summary))
    return "\n".join([*lines, r"\end{table}", *_beside(summary), ""])


def _beside(summary: Summary) -> list[str]:
    """Footnotes and remarks as text: a page and more of them for seven methods, which a table could not break."""
    found = [*footnotes(summary), *remarks(summary)]
    if not found:
        return []
    return [
        r"{\footnotesize\setlength{\parindent}{0pt}\setlength{\parskip}{3pt}\raggedright",
        rf"To Table~\ref{{tab:{summary['suite']}}}:",
        *(rf"\par {escape(each)}" for each in found),
        r"\par}",
    ]


def _heads(summary: Summary, part: slice) -> list[str]:
    """Names of columns with the direction of better values, and their units; seconds of training come last."""
    names = [f"{escape(column['label'])} {ARROWS[column['direction']]}" for column in summary["columns"]]
    units = [escape(column["unit"]) for column in summary["columns"]]
    lines = ("Method", [*names, "Training"]), ("", [*units, "s"])
    return [rf"{' & '.join([label, *map(over, texts[part])])} \\" for label, texts in lines]


def _group(summary: Summary, row: RowSummary, notes: list[str]) -> Group:
    """A line of means with published values behind them, and one of differences with the half-widths of intervals."""
    means, differences = [], []
    for column in summary["columns"]:
        cell = summary["cells"][row["key"]][column["key"]]
        published = published_beside(summary, row["key"], column)
        beside = "" if published is None else rf"\textcolor{{gray}}{{({published:.{column['decimals']}f})}}"
        behind = escape(marks(summary, row["key"], column["key"])) + beside
        verdict = shown_verdict(summary, row["key"], column["key"], cell["difference"])
        means.append(_mean(cell, column, verdict, notes)._replace(behind=behind))
        differences.append(_difference(cell, column))
    seconds = Entry() if row["seconds"] is None else Entry(f"{row['seconds']:.0f}")
    lines = [Line(row_label(row), [*means, seconds]), Line("", [*differences, Entry()])]
    return Group([line for line in lines if any(line.entries)])


def _mean(cell: CellSummary, column: ColumnSummary, verdict: Verdict | None, notes: list[str]) -> Entry:
    if cell["mean"] is None:
        return Entry(f"n/a{note_mark(note_index(notes, cell['reason'] or 'not measured'))}")
    return Entry(f"{cell['mean']:.{column['decimals']}f}", colour_of(verdict))


def _difference(cell: CellSummary, column: ColumnSummary) -> Entry:
    difference, decimals = cell["difference"], column["decimals"]
    if difference is None:
        return Entry()
    width = half_width(difference)
    behind = "" if width is None else rf"\scriptsize $\pm${width:.{decimals}f}"
    return Entry(signed(difference["mean"], decimals), r"\scriptsize ", behind)


def _caption(summary: Summary) -> str:
    reference = [row_label(row) for row in summary["rows"] if row["key"] == summary["reference"]]
    differences = (
        f" Below each value: paired difference to {reference[0]} and the half-width of its 95\\,\\% $t$ interval."
        if reference
        else ""
    )
    seeds, scenes = len(summary["seeds"]), ", ".join(summary["scenes"])
    published = (
        f" In grey: published ({escape(summary['published_data'])})."
        if any(
            published_beside(summary, row["key"], each) is not None
            for row in summary["rows"]
            for each in summary["columns"]
        )
        else ""
    )
    return (
        f"{escape(summary['title'])}. Mean over {seeds} seed{'' if seeds == 1 else 's'} on {escape(scenes)}; preset"
        f" {escape(summary['preset'])}; metric protocol {escape(summary['protocol'])}.{unfinished(summary)}"
        f"{differences}{published}"
    )


def suite_markdown(summary: Summary) -> str:
    """Measured values with their paired differences, then the published values in columns of their own."""
    published = [column for column in summary["columns"] if _is_published(summary, column)]
    heads = ["", *map(heading, summary["columns"]), *(f"paper: {heading(column)}" for column in published), "s"]
    lines = [f"# {summary['title']}", "", *table_head(heads)]
    for row in summary["rows"]:
        values = [measured(summary, row["key"], column) for column in summary["columns"]]
        beside = [
            f"{value:.{c['decimals']}f}" if (value := published_beside(summary, row["key"], c)) else ""
            for c in published
        ]
        seconds = "" if row["seconds"] is None else f"{row['seconds']:.0f}"
        lines.append(table_line([row["text"], *values, *beside, seconds]))
    below = [
        f"{_brackets(summary)}{run_note(summary)}",
        *suite_legend(summary, coloured=False),
        *footnotes(summary),
        *remarks(summary),
    ]
    return "\n".join([*lines, *(line for paragraph in below for line in ("", paragraph)), ""])


def _is_published(summary: Summary, column: ColumnSummary) -> bool:
    return any(published_beside(summary, row["key"], column) is not None for row in summary["rows"])


def _brackets(summary: Summary) -> str:
    """What the brackets hold, as a sentence; empty without a reference row."""
    reference = summary["reference"]
    if reference is None:
        return ""
    return f"In brackets: paired difference to '{row_texts(summary)[reference]}', with its 95 % t interval. "


def measured(summary: Summary, row: str, column: ColumnSummary) -> str:
    """The mean with the marks of its footnotes, and the paired difference with its interval and verdict."""
    cell, decimals = summary["cells"][row][column["key"]], column["decimals"]
    if cell["mean"] is None:
        return f"n/a ({cell['reason']})"
    text = f"{cell['mean']:.{decimals}f}{marks(summary, row, column['key'])}"
    difference = cell["difference"]
    if difference is None:
        return text
    if difference["low"] is None or difference["high"] is None:
        return f"{text} ({signed(difference['mean'], decimals)})"
    middle, low, high = (signed(end, decimals) for end in (difference["mean"], difference["low"], difference["high"]))
    verdict = shown_verdict(summary, row, column["key"], difference)
    return f"{text} ({middle}, {low} to {high}{'' if verdict is None else f': {verdict}'})"


def suite_csv(summary: Summary) -> str:
    """One record per value: the mean, its difference, interval, rank, published value, reason and doubt."""
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
                    "rank": cell.get("rank"),
                    "smallest_resolved": column.get("smallest"),
                    "published": summary["published"].get(row["key"], {}).get(column["key"]),
                    "published_by": column.get("published_by"),
                    "reason": cell["reason"],
                    "doubt": texts_of(summary, row["key"], column["key"]) or None,
                }
            )
    return pd.DataFrame.from_records(records).to_csv(index=False)
