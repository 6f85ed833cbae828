"""The suite's table as a paper prints it: means alone, the best in bold, one heading over columns of one quantity."""

from collections.abc import Sequence
from itertools import groupby

from ..summary import Summary, counted_scenes, protocol_title
from ..tables.caption import preset_and_recipe, unfinished
from ..tables.model import Column, PrintedCell, Table, stored_ranks
from ..tables.suite import suite_table
from ..wording import marked, mean_over
from .latex import ARROWS, LEFT, as_formula, escape, tabular

MISSING = "--"

HIGHLIGHTS = (
    "Bold: the best mean; italic: another row is resolved to be better than this one, or than one with a better mean"
    " (paired $t$ tests, Holm)."
)


def camera_ready(summary: Summary, keys: Sequence[str] = ()) -> str:
    """The table environment, for documents that load booktabs and graphicx.

    ``keys``: the columns, in this order; all that have a value, if it is empty.
    """
    table = suite_table(summary)
    at = {column.key: place for place, column in enumerate(table.columns)}
    has_value = {key for key, place in at.items() if any(row.cells[place].value is not None for row in table.rows)}
    chosen = [at[key] for key in (keys or [key for key in at if key in has_value])]
    columns = [table.columns[place] for place in chosen]
    printed = [_column(summary, table, place) for place in chosen]
    lines = [
        rf"{' & '.join([as_formula(row.text), *values])} \\" for row, *values in zip(table.rows, *printed, strict=True)
    ]
    marks = {mark for row in table.rows for place in chosen for mark in row.cells[place].marks}
    scenes = ", ".join(marked(summary, each) for each in counted_scenes(summary))
    below = [f"Scenes: {escape(scenes)}. {'PSNR in dB. ' * any(each.unit == 'dB' for each in columns)}{HIGHLIGHTS}"]
    below += (escape(line) for line in table.footnotes if line[:1] in marks)
    return "\n".join(
        [
            r"\begin{table}[t]",
            r"\centering",
            rf"\caption{{{_caption(summary)}}}",
            rf"\label{{tab:{table.name}-paper}}",
            *tabular(f"l{'c' * len(columns)}", _headings(columns), lines),
            LEFT,
            *(rf"\par\smallskip\footnotesize {line}" for line in below),
            r"\end{table}",
            "",
        ]
    )


def _column(summary: Summary, table: Table, place: int) -> list[str]:
    """The values of a column, row by row."""
    column, cells = table.columns[place], [row.cells[place] for row in table.rows]
    ranks = stored_ranks(summary["cells"], column.key, column.direction)
    best = _best(column, cells)
    return [_value(cell, best, ranks.get(row.key, 1)) for row, cell in zip(table.rows, cells, strict=True)]


def _best(column: Column, cells: Sequence[PrintedCell]) -> str:
    """The best mean as it is printed; empty without any, and for counts."""
    values = [(cell.value, cell.text) for cell in cells if isinstance(cell.value, int | float)]
    if column.direction == "none" or not values:
        return ""
    return max(values)[1] if column.direction == "up" else min(values)[1]


def _value(cell: PrintedCell, best: str, rank: int) -> str:
    if cell.value is None:
        return MISSING
    style = r"\textbf" if cell.text == best else r"\textit" if rank > 1 else ""
    return (f"{style}{{{escape(cell.text)}}}" if style else escape(cell.text)) + escape(cell.marks)


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


def _caption(summary: Summary) -> str:
    setup = f"Mean over {mean_over(summary, named=False)}; {preset_and_recipe(summary)}"
    return (
        f"{escape(summary['title'])}. {escape(setup)}; protocol {escape(protocol_title(summary))}."
        f"{escape(unfinished(summary))}"
    )
