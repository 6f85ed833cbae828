"""The sentences below a table: the units of its intervals, its resolved differences, and the smallest one that it could
show."""

from collections.abc import Sequence
from dataclasses import replace

from ..analysis.comparisons import ERROR_RATE
from ..summary import Interval
from ..wording import count_of, number, population
from .model import Column, Table

COLOURS = "In colour: better, or worse, than {reference}, where that is resolved; values with a mark have no colour."
WORDS = "Better, or worse, than {reference}, where that is resolved; values with a mark are left out."


def with_legend(table: Table, scenes: Sequence[str]) -> Table:
    """The table of these scenes with the sentences of its legend, for reports with and without colours."""
    return replace(table, legend=legend(table, scenes, COLOURS), legend_in_words=legend(table, scenes, WORDS))


def legend(table: Table, scenes: Sequence[str], shown: str) -> list[str]:
    """The sentences of a table of these scenes; none without a reference row or without measured differences.

    ``shown``: how a report shows what is resolved, ``COLOURS`` or ``WORDS``.
    """
    intervals = [cell.difference.interval for cell in table.cells if cell.difference is not None]
    if table.reference is None or not intervals:
        return []
    tested = [each for each in intervals if each["p_value"] is not None]
    if not tested:
        return [
            "One scene with one seed, or one of several scenes: differences have no intervals. More seeds speak of a"
            " scene, more scenes of scenes like these."
        ]
    scene = scenes[0] if len(scenes) == 1 else "one scene"
    over = [population(*units, scene) for units in sorted({(each["over"], each["units"]) for each in tested})]
    single = ", and none where a row has a single one of these" if len(tested) < len(intervals) else ""
    return [
        f"Differences are paired by scene and seed, with 95 % t intervals {'; or '.join(over)}{single}.",
        _resolved(table.columns, shown.format(reference=repr(table.reference.text))),
        _power(table.columns, tested),
    ]


def _resolved(columns: Sequence[Column], shown: str) -> str:
    tested = [column for column in columns if column.smallest is not None]
    rate = min(1.0, ERROR_RATE * len(tested))
    return (
        f"{shown} Resolved: paired t tests with Holm's correction over the"
        f" rows of a column. If no rows differed, at most {100 * ERROR_RATE:.0f} % of columns would have a false"
        f" difference, and at most {100 * rate:.0f} % of tables of {count_of(len(tested), 'column')}."
    )


def _power(columns: Sequence[Column], tested: Sequence[Interval]) -> str:
    smallest = [
        f"{column.label} {number(column.smallest, column.decimals)} {column.unit}".rstrip()
        for column in columns
        if column.smallest is not None
    ]
    over, units = min(((each["over"], each["units"]) for each in tested), key=lambda each: each[1])
    return (
        "The smallest true difference of a typical row that would be resolved in four of five runs like this one"
        f" ({count_of(units, over[:-1])}): {', '.join(smallest)}."
    )
