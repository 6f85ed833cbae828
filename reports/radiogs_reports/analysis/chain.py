"""A chain of rows, each of which adds a change to the row before: the worth of every step."""

from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

from ..statistics import Estimate, Sample, mean_of
from ..summary import ColumnSummary, Summary, directed_columns, doubted_rows, row_texts
from ..wording import heading, label_with_unit, signed
from .comparisons import compared
from .report import Grid, Item, Report, estimate_fields, estimate_item, name_item, plain_item
from .samples import changed_fields, costs_of, made_from, values_of

FEWEST = 3
"""Fewest steps of a chain."""

SECONDS: ColumnSummary = {
    "key": "training/seconds", "label": "Training", "unit": "s", "direction": "down", "decimals": 0,
}  # fmt: skip
"""Processor seconds of training, as a column."""


class Worth(NamedTuple):
    """A metric along a chain: its value at the first and the last row, and the difference of each step."""

    column: ColumnSummary
    first: Estimate | None
    last: Estimate | None
    steps: dict[str, Estimate]
    """By the row that the step leads to; steps whose rows share no scene and seed are absent."""
    resolved: frozenset[str]
    """Rows whose step is resolved (paired t test, Holm over the metric's steps), at places without a footnote."""


def chain_report(summary: Summary) -> Report | None:
    """The report of a run whose rows are a chain with at least one finished cell each; None for other runs."""
    rows = chain_of(summary)
    if rows is None:
        return None
    worth, texts = worth_of(summary, rows), row_texts(summary)
    records = [
        {"metric": each.column["key"], "row": row, "after": before} | estimate_fields(difference=each.steps.get(row))
        for each in worth
        for before, row in pairwise(rows)
    ]
    return Report([_sentence(each, texts) for each in worth], [_grid(worth, rows, texts)], records)


def chain_of(summary: Summary) -> list[str] | None:
    """The rows in order, if each changes fields in the row before that no other step changes; else None."""
    rows = [row["key"] for row in summary["rows"]]
    contents = [made_from(summary, row) for row in rows]
    if len(rows) <= FEWEST or any(content is None or "variant" not in content for content in contents):
        return None
    known = [content for content in contents if content is not None]
    if len({repr([content.get("method"), content.get("budget", {})]) for content in known}) > 1:
        return None
    changes = [changed_fields(one["variant"], other["variant"]) for one, other in pairwise(known)]
    apart = len(set().union(*changes)) == sum(map(len, changes))
    return rows if all(changes) and apart else None


def worth_of(summary: Summary, rows: list[str]) -> list[Worth]:
    """The worth of the steps of a chain, for every column that has a better side and for the seconds of training."""
    found: list[tuple[ColumnSummary, Mapping[str, Sample]]] = [
        (column, {row: values_of(summary, row, column["key"]) for row in rows}) for column in directed_columns(summary)
    ]
    if all(column["key"] != SECONDS["key"] for column, _ in found):
        found.append((SECONDS, {row: costs_of(summary, row, "seconds") for row in rows}))
    worth = []
    for column, values in found:
        if any(values.values()):
            judged = compared({row: (values[row], values[at]) for at, row in pairwise(rows)}, column["direction"])
            steps = {row: each.difference for row, each in judged.items()}
            doubted = doubted_rows(summary, column["key"])
            trusted = {row for before, row in pairwise(rows) if doubted.isdisjoint((before, row))}
            told = frozenset(row for row in trusted & steps.keys() if judged[row].verdict is not None)
            worth.append(Worth(column, mean_of(values[rows[0]]), mean_of(values[rows[-1]]), steps, told))
    return worth


def _sentence(worth: Worth, texts: Mapping[str, str]) -> str:
    decimals = worth.column["decimals"]
    ends = [None if each is None else f"{each.mean:.{decimals}f}" for each in (worth.first, worth.last)]
    said = [f"{texts[row]} {signed(step.mean, decimals)}" for row, step in worth.steps.items() if row in worth.resolved]
    steps = f"resolved steps: {', '.join(said)}" if said else "no step is resolved"
    return f"{label_with_unit(worth.column)}: {ends[0]} to {ends[1]}; {steps}."


def _grid(worth: list[Worth], rows: list[str], texts: Mapping[str, str]) -> Grid:
    heads = ["row", *(heading(each.column) for each in worth)]
    lines: list[list[Item]] = [
        [name_item(texts[rows[0]]), *(plain_item(each.first, each.column["decimals"]) for each in worth)]
    ]
    for row in rows[1:]:
        steps = [estimate_item(each.steps.get(row), each.column["decimals"]) for each in worth]
        lines.append([name_item(f"+ {texts[row]}"), *steps])
    lines.append([name_item("all together"), *(plain_item(each.last, each.column["decimals"]) for each in worth)])
    note = (
        "Every row has the changes of all rows above it. First and last line: values. Between them: differences to the"
        " row above, paired by scene and seed; ± is the half-width of the 95 % t interval, and without it there is only"
        " one unit to compare. Resolved: paired t tests with Holm's correction over the steps of a metric. In another"
        " order every step would have another share."
    )
    return Grid("chain", "What each step is worth", note, heads, lines)
