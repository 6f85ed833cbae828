"""The suite's table as a paper prints it: means alone, the best in bold, one heading over columns of one quantity."""

from collections.abc import Sequence
from itertools import groupby

from ..summary import Summary, protocol_title
from ..tables.caption import preset_and_recipe, unfinished
from ..tables.model import Cell, Column
from ..tables.suite import suite_table
from ..wording import count_of
from .latex import ARROWS, BOX_BEGIN, BOX_END, END, PREAMBLE, as_formula, escape

HIGHLIGHTS = {1: r"\textbf{%s}", 2: r"\underline{%s}"}
"""How a value is printed, by one more than the number of rows that are resolved to be better."""

MISSING = "--"


def camera_ready_document(summary: Summary, keys: Sequence[str] = ()) -> str:
    """A document of its own around ``camera_ready``, which pdflatex compiles."""
    return f"{PREAMBLE}{camera_ready(summary, keys)}{END}"


def camera_ready(summary: Summary, keys: Sequence[str] = ()) -> str:
    """The table environment, for documents that load booktabs and graphicx.

    ``keys``: the columns, in this order; all that have a value, if it is empty. A column in which nothing is resolved
    has no value in bold.
    """
    table = suite_table(summary)
    at = {column.key: place for place, column in enumerate(table.columns)}
    has_value = {key for key, place in at.items() if any(row.cells[place].value is not None for row in table.rows)}
    chosen = [at[key] for key in (keys or [key for key in at if key in has_value])]
    columns = [table.columns[place] for place in chosen]
    ranks = {column.key: _ranks(summary, column.key) for column in columns}
    lines = [
        " & ".join(
            [as_formula(row.text)]
            + [_value(row.cells[place], ranks[table.columns[place].key].get(row.key)) for place in chosen]
        )
        for row in table.rows
    ]
    marks = {mark for row in table.rows for place in chosen for mark in row.cells[place].marks}
    below = [escape(line) for line in table.footnotes if line[:1] in marks]
    return "\n".join(
        [
            r"\begin{table}[t]",
            r"\centering",
            rf"\caption{{{_caption(summary, highlighted=any(ranks.values()))}}}",
            rf"\label{{tab:{table.name}-paper}}",
            BOX_BEGIN,
            rf"\begin{{tabular}}{{l{'c' * len(columns)}}}",
            r"\toprule",
            *_headings(columns),
            r"\midrule",
            *(rf"{line} \\" for line in lines),
            r"\bottomrule",
            r"\end{tabular}}",
            BOX_END,
            *(rf"\par\smallskip\footnotesize {line}" for line in below),
            r"\end{table}",
            "",
        ]
    )


def _ranks(summary: Summary, key: str) -> dict[str, int]:
    """Rank by row, of a column in which some row is resolved to be worse; else empty."""
    found = {row: cells[key].get("rank") for row, cells in summary["cells"].items() if key in cells}
    ranks = {row: rank for row, rank in found.items() if rank is not None}
    return ranks if max(ranks.values(), default=1) > 1 else {}


def _value(cell: Cell, rank: int | None) -> str:
    if cell.value is None:
        return MISSING
    return HIGHLIGHTS.get(rank or 0, "%s").replace("%s", escape(cell.text)) + escape(cell.marks)


def _headings(columns: Sequence[Column]) -> list[str]:
    """A line of quantities over a line of metrics; neighbours of one quantity share it."""
    quantities, rules, names, at = [""], [], [""], 2
    for quantity, neighbours in groupby(columns, lambda column: _parts(column)[0]):
        count = len(list(neighbours))
        quantities.append(rf"\multicolumn{{{count}}}{{c}}{{{as_formula(quantity)}}}")
        rules += [rf"\cmidrule(lr){{{at}-{at + count - 1}}}"] if quantity else []
        at += count
    for column in columns:
        unit = f" ({column.unit})" if column.unit not in ("", "dB") else ""
        names.append(f"{as_formula(_parts(column)[1] + unit)} {ARROWS.get(column.direction, '')}".strip())
    return [rf"{' & '.join(quantities)} \\", "".join(rules), rf"{' & '.join(names)} \\"]


def _parts(column: Column) -> tuple[str, str]:
    """The quantity and the metric of a column's label: ``NVS PSNR`` is of NVS."""
    quantity, _, metric = column.label.rpartition(" ")
    return quantity, metric


def _caption(summary: Summary, *, highlighted: bool) -> str:
    scenes, seeds = summary["scenes"], len(summary["seeds"])
    over = f"{count_of(len(scenes), 'scene')} ({', '.join(scenes)})" if len(scenes) > 1 else f"scene {scenes[0]}"
    setup = f"Mean over {over} and {count_of(seeds, 'seed')}; {preset_and_recipe(summary)}"
    bold = " Bold: no other row is better beyond its 95\\,\\% interval; underlined: one is." if highlighted else ""
    return (
        f"{escape(summary['title'])}. {escape(setup)}; metrics by protocol {escape(protocol_title(summary))}."
        f"{escape(unfinished(summary))}{bold}"
    )
