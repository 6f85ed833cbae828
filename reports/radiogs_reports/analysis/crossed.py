"""Several pairs of rows that differ in one setting only: the worth of this setting beside different other settings.

Such pairs show whether two parts have the same effect: then one is worth less beside the other.
"""

from itertools import combinations
from typing import Any, NamedTuple

from ..summary import ColumnSummary, Summary, directed_columns, doubted_rows, row_texts
from ..wording import heading, label_with_unit, signed
from .comparisons import Comparison, compared
from .report import Grid, Item, Record, Report, estimate_fields, estimate_item, name_item
from .samples import changed_fields, flat, made_from, values_of

FEWEST = 2
"""Fewest pairs of rows that differ in the setting alone."""


class Crossed(NamedTuple):
    """A setting, two values of it, and the pairs of rows that differ in it alone."""

    setting: str
    """Its dotted name."""
    values: tuple[Any, Any]
    """Its value in the first row of each pair, and in the second."""
    pairs: list[tuple[str, str]]

    @property
    def text(self) -> str:
        """``masking = smith instead of none``."""
        return f"{self.setting} = {self.values[0]} instead of {self.values[1]}"


def crossed_report(summary: Summary) -> Report | None:
    """The report of a run in which a setting differs alone in several pairs of rows; None for other runs."""
    found = crossed_of(summary)
    if not found:
        return None
    columns, texts = directed_columns(summary), row_texts(summary)
    sentences, records = list[str](), list[Record]()
    lines: list[list[Item]] = []
    for crossed in found:
        worth = {column["key"]: _compared(summary, crossed, column) for column in columns}
        sentences += [_sentence(summary, crossed, each, own) for each in columns if (own := worth[each["key"]])]
        for pair in crossed.pairs:
            shown = [(worth[each["key"]].get(pair), each["decimals"]) for each in columns]
            items = [estimate_item(one.difference if one else None, decimals) for one, decimals in shown]
            lines.append([name_item(crossed.text), name_item(texts[pair[0]]), *items])
            named = {"setting": crossed.setting, "row": pair[0], "instead_of": pair[1]}
            records += [
                {**named, "metric": key} | estimate_fields(difference=own[pair].difference)
                for key, own in worth.items()
                if pair in own
            ]
    return Report(sentences, [_grid(columns, lines)], records)


def crossed_of(summary: Summary) -> list[Crossed]:
    """Settings of the variant, with two values, that are the only difference in at least ``FEWEST`` pairs of rows.

    The first row of a pair comes first in the table.
    """
    rows = [row["key"] for row in summary["rows"]]
    contents = {
        row: content for row in rows if (content := made_from(summary, row)) is not None and "variant" in content
    }
    groups: dict[str, Crossed] = {}
    for one, other in combinations(contents, 2):
        changed = _changed(contents[one], contents[other])
        if changed is not None:
            name, values = changed
            groups.setdefault(f"{name} {values!r}", Crossed(name, values, [])).pairs.append((one, other))
    return [each for each in groups.values() if len(each.pairs) >= FEWEST]


def _changed(one: dict[str, Any], other: dict[str, Any]) -> tuple[str, tuple[Any, Any]] | None:
    """The one setting in which two rows differ, and its values; None if they differ in more, or in anything else."""
    if one.get("method") != other.get("method") or one.get("budget", {}) != other.get("budget", {}):
        return None
    left, right = flat(one["variant"]), flat(other["variant"])
    names = list(changed_fields(left, right))
    return (names[0], (left.get(names[0]), right.get(names[0]))) if len(names) == 1 else None


def _compared(summary: Summary, crossed: Crossed, column: ColumnSummary) -> dict[tuple[str, str], Comparison]:
    """Differences, first row minus second row, for each pair that shares a scene and seed."""
    samples = {row: values_of(summary, row, column["key"]) for pair in crossed.pairs for row in pair}
    return compared({(one, two): (samples[one], samples[two]) for one, two in crossed.pairs}, column["direction"])


def _sentence(summary: Summary, crossed: Crossed, column: ColumnSummary, own: dict[tuple[str, str], Comparison]) -> str:
    doubted = doubted_rows(summary, column["key"])
    told = [pair for pair, found in own.items() if found.verdict is not None and doubted.isdisjoint(pair)]
    means = [found.difference.mean for found in own.values()]
    return (
        f"{crossed.text}, {label_with_unit(column)}: from {signed(min(means), column['decimals'])} to"
        f" {signed(max(means), column['decimals'])} in {len(own)} pairs of rows, resolved in {len(told)}."
    )


def _grid(columns: list[ColumnSummary], lines: list[list[Item]]) -> Grid:
    note = (
        "Each line is a pair of rows that differ in one setting alone: the named row less the row with the other value,"
        " paired by scene and seed; ± is the half-width of the 95 % t interval, and without it there is only one unit"
        " to compare. Resolved, in the sentences: paired t tests with Holm's correction over the pairs of a setting."
    )
    heads = ["setting", "in row", *(heading(column) for column in columns)]
    return Grid("crossed", "What a setting is worth beside others", note, heads, lines)
