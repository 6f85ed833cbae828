"""Rows that are alike but for one setting, in several pairs: what that setting is worth beside different others.

Such pairs tell whether a part does what another one does as well: then it is worth less beside that one.
"""

from collections.abc import Mapping
from itertools import combinations
from typing import Any, NamedTuple

from ..statistics import Estimate, paired_difference
from ..summary import ColumnSummary, Summary, row_texts
from ..wording import heading, label_with_unit, signed
from .comparisons import ERROR_RATE, holm
from .grid import Grid, Item, estimate_item, name_item
from .samples import flat, made_from, values_of

FEWEST = 2
"""Pairs of rows that a setting has to differ in alone."""


class Crossed(NamedTuple):
    """A setting, two values of it, and the pairs of rows that differ in nothing else."""

    setting: str
    """Its dotted name."""
    values: tuple[Any, Any]
    """Its value in the first row of each pair, and in the second."""
    pairs: list[tuple[str, str]]


class CrossedReport(NamedTuple):
    """The differences of all pairs, the sentences about them, and the grid that shows them."""

    found: list[Crossed]
    differences: dict[tuple[str, str, str], Estimate]
    """First row less second row, by first row, second row and column."""
    sentences: list[str]
    grid: Grid


def crossed_report(summary: Summary) -> CrossedReport | None:
    """The report of a run in which a setting differs alone in several pairs of rows; None for other runs."""
    found = crossed_of(summary)
    if not found:
        return None
    columns = [column for column in summary["columns"] if column["direction"] in ("up", "down")]
    differences: dict[tuple[str, str, str], Estimate] = {}
    for each in found:
        for one, other in each.pairs:
            for column in columns:
                key = column["key"]
                difference = paired_difference(values_of(summary, one, key), values_of(summary, other, key))
                if difference is not None:
                    differences[one, other, key] = difference
    texts = row_texts(summary)
    sentences = [
        sentence for each in found for column in columns if (sentence := _sentence(summary, each, column, differences))
    ]
    return CrossedReport(found, differences, sentences, _grid(found, columns, differences, texts))


def crossed_of(summary: Summary) -> list[Crossed]:
    """Settings of the variant with two values that are all that differs in at least ``FEWEST`` pairs of rows.

    The first row of a pair is the one that stands first in the table.
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


def _changed(one: Mapping[str, Any], other: Mapping[str, Any]) -> tuple[str, tuple[Any, Any]] | None:
    """The one setting in which two rows differ, and its values; None if they differ in more, or in anything else."""
    if one.get("method") != other.get("method") or one.get("budget", {}) != other.get("budget", {}):
        return None
    left, right = flat(one["variant"]), flat(other["variant"])
    names = [name for name in left.keys() | right.keys() if left.get(name) != right.get(name)]
    return (names[0], (left.get(names[0]), right.get(names[0]))) if len(names) == 1 else None


def _sentence(
    summary: Summary, each: Crossed, column: ColumnSummary, differences: Mapping[tuple[str, str, str], Estimate]
) -> str:
    own = {pair: found for pair in each.pairs if (found := differences.get((*pair, column["key"]))) is not None}
    if not own:
        return ""
    doubted = {row for doubt in summary.get("doubts", []) if doubt["column"] == column["key"] for row in doubt["rows"]}
    known = {pair: found.p_value for pair, found in own.items() if found.p_value is not None}
    resolved = [pair for pair, adjusted in holm(known).items() if adjusted < ERROR_RATE and doubted.isdisjoint(pair)]
    least, most = min(own.values(), key=lambda each: each.mean), max(own.values(), key=lambda each: each.mean)
    return (
        f"{_said(each)}, {label_with_unit(column)}: from {signed(least.mean, column['decimals'])} to"
        f" {signed(most.mean, column['decimals'])} in {len(own)} pairs of rows, resolved in {len(resolved)}."
    )


def _said(each: Crossed) -> str:
    return f"{each.setting} = {each.values[0]} instead of {each.values[1]}"


def _grid(
    found: list[Crossed],
    columns: list[ColumnSummary],
    differences: Mapping[tuple[str, str, str], Estimate],
    texts: Mapping[str, str],
) -> Grid:
    lines: list[list[Item]] = [
        [
            name_item(_said(each)),
            name_item(texts[one]),
            *(estimate_item(differences.get((one, other, column["key"])), column["decimals"]) for column in columns),
        ]
        for each in found
        for one, other in each.pairs
    ]
    note = (
        "Each line is a pair of rows that differ in one setting alone: the named row less the row with the other value,"
        " paired by scene and seed; ± is the half-width of the 95 % t interval, and without it there is only one unit"
        " to compare. Resolved, in the sentences: paired t tests with Holm's correction over the pairs of a setting."
    )
    heads = ["setting", "in row", *(heading(column) for column in columns)]
    return Grid("crossed", "What a setting is worth beside others", note, heads, lines)
