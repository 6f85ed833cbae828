"""The sentences below a table: the units of its intervals, its resolved differences, and the smallest one that it could
show."""

from collections.abc import Sequence

from ..analysis.comparisons import ERROR_RATE
from ..summary import Interval
from ..wording import count_of, number, population, signed
from .model import Cell, Column, Row, Table

COLOURS = "In colour: better, or worse, than {reference}, where that is resolved; values with a mark have no colour."
WORDS = "Better, or worse, than {reference}, where that is resolved; values with a mark are left out."


def legend(table: Table, scenes: Sequence[str], coloured: bool) -> list[str]:
    """The sentences of a table of these scenes; none without a reference row or without measured differences.

    ``coloured``: colours show what is resolved; otherwise words do.
    """
    intervals = [cell.difference.interval for cell in table.cells if cell.difference is not None]
    if table.reference is None or not intervals:
        return []
    tested = [each for each in intervals if each["p_value"] is not None]
    if not tested:
        return [
            "One scene with one seed: differences have no intervals, and none is resolved. More seeds speak of this"
            " scene, more scenes of scenes like these."
        ]
    return [
        _intervals(scenes, tested),
        _resolved(table.columns, (COLOURS if coloured else WORDS).format(reference=repr(table.reference.text))),
        _power(table.columns, tested),
        *_beside_the_paper(table, table.reference),
    ]


def _intervals(scenes: Sequence[str], tested: Sequence[Interval]) -> str:
    counted = sorted({(each["over"], each["units"]) for each in tested})
    scene = scenes[0] if len(scenes) == 1 else "one scene"
    texts = [population(over, units, scene) for over, units in counted]
    return f"Differences are paired by scene and seed, with 95 % t intervals {'; or '.join(texts)}."


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


def _beside_the_paper(table: Table, reference: Row) -> list[str]:
    """The published differences, by whether this table would have resolved one of that size, and whether it did."""
    seen: dict[str, dict[str, list[str]]] = {}
    for row in table.rows:
        for column, cell, base in zip(table.columns, row.cells, reference.cells, strict=True):
            published, zero = _published(cell), _published(base)
            if published is None or zero is None or cell.difference is None or column.smallest is None:
                continue
            difference = published - zero
            outcome = _outcome(difference, cell.difference.interval, column.smallest)
            text = f"{column.label} {signed(difference, column.decimals)}"
            seen.setdefault(outcome, {}).setdefault(row.text, []).append(text)
    others = sorted(
        {column.published_by for column in table.columns if column.published_by and column.direction != "none"}
    )
    by = f" (published by protocol {', '.join(others)})" if others else ""
    return [
        f"{outcome}{by}: {'; '.join(_listed(text, items) for text, items in seen[outcome].items())}."
        for outcome in OUTCOMES
        if outcome in seen
    ]


def _listed(text: str, items: Sequence[str]) -> str:
    return f"{text}: {', '.join(items)}"


def _published(cell: Cell) -> float | None:
    """The published value, whatever its conventions; None where nothing was published."""
    published = cell.published or cell.apart
    value = None if published is None else published.value
    return None if isinstance(value, str) else value


OUTCOMES = SAME, OTHER, ABSENT, SMALL = (
    "The paper's differences that are resolved here with the same sign",
    "The paper's differences that are resolved here with the other sign",
    "Not resolved here, where the paper's difference would have been",
    "Not resolved here, where the paper's difference is too small for this table",
)


def _outcome(published: float, difference: Interval, smallest: float) -> str:
    if difference["p_value"] is not None and difference["p_value"] <= ERROR_RATE:
        return SAME if published * difference["mean"] > 0 else OTHER
    return ABSENT if abs(published) >= max(smallest, difference["smallest"] or 0.0) else SMALL
