"""What a table says below it: what its intervals count, what is resolved, and what it could have shown."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ..doubts import marks
from ..summary import ColumnSummary, Interval, PaperColumn, PaperTable, PaperValue, Summary, Verdict, row_texts
from ..wording import count_of, population, signed
from .comparisons import ERROR_RATE

COLOURS = "In colour: better, or worse, than {reference}, where that is resolved; values with a mark have no colour."
WORDS = "Better, or worse, than {reference}, where that is resolved; values with a mark are left out."


class Column(NamedTuple):
    """A column: its label with group, unit, printed decimals, and the smallest difference that it could have shown.

    ``by``: the protocol of its published values, where that is another than the run's; else empty.
    """

    key: str
    label: str
    unit: str
    decimals: int
    smallest: float | None
    by: str


class Compared(NamedTuple):
    """A table as its legend sees it: the reference row, labels of all rows, and by row and column the differences to
    the reference row and the published values."""

    reference: str | None
    texts: Mapping[str, str]
    columns: Sequence[Column]
    differences: Mapping[str, Mapping[str, Interval | None]]
    published: Mapping[str, Mapping[str, float]]
    scenes: Sequence[str]
    coloured: bool


def suite_legend(summary: Summary, coloured: bool = True) -> list[str]:
    """Sentences below the suite's table; none without a reference row. ``coloured``: what is resolved has a colour."""
    columns = [_column(each, each["label"]) for each in summary["columns"]]
    differences = {
        row: {column: cell["difference"] for column, cell in cells.items()} for row, cells in summary["cells"].items()
    }
    return _legend(
        Compared(
            summary["reference"],
            row_texts(summary),
            columns,
            differences,
            summary["published"],
            summary["scenes"],
            coloured,
        )
    )


def paper_legend(table: PaperTable, summary: Summary, coloured: bool = True) -> list[str]:
    """Sentences below a table of the paper; none without measured differences. ``coloured`` as in ``suite_legend``."""
    texts = {row["key"]: row["text"] for row in table["rows"]}
    columns = [
        _column(each, f"{each['group']} {each['label']}".strip())
        for each in table["columns"]
        if each["direction"] != "none"
    ]
    differences = {
        row: {column: value["difference"] for column, value in values.items()} for row, values in table["cells"].items()
    }
    printed = {
        row: {column: float(text) for column, value in values.items() if (text := value["published"]) is not None}
        for row, values in table["cells"].items()
    }
    return _legend(Compared(table["reference"], texts, columns, differences, printed, summary["scenes"], coloured))


def _column(column: ColumnSummary | PaperColumn, label: str) -> Column:
    by = column.get("published_by", "")
    return Column(column["key"], label, column["unit"], column["decimals"], column.get("smallest"), by)


def shown_verdict(summary: Summary, row: str, column: str, difference: Interval | None) -> Verdict | None:
    """What a value is coloured by; None where a footnote concerns it or the reference row's value."""
    reference = summary["reference"]
    marked = any(marks(summary, each, column) for each in (row, reference) if each is not None)
    return None if difference is None or marked else difference["verdict"]


def without_marked(table: PaperTable, summary: Summary) -> PaperTable:
    """The table without verdicts on values of which a footnote says that they carry no information."""
    cells: dict[str, dict[str, PaperValue]] = {
        row: {
            column: value
            if value["difference"] is None
            else {
                **value,
                "difference": {
                    **value["difference"], "verdict": shown_verdict(summary, row, column, value["difference"])
                },
            }
            for column, value in values.items()
        }
        for row, values in table["cells"].items()
    }  # fmt: skip
    return {**table, "cells": cells}


def verdict_of(value: PaperValue) -> Verdict | None:
    """Whether a value is resolved to be better or worse than the reference row's."""
    return None if value["difference"] is None else value["difference"]["verdict"]


def _legend(table: Compared) -> list[str]:
    intervals = [each for row in table.differences.values() for each in row.values() if each is not None]
    if table.reference is None or not intervals:
        return []
    tested = [each for each in intervals if each["p_value"] is not None]
    if not tested:
        return [
            "One scene with one seed: differences have no intervals, and none is resolved. More seeds speak of this"
            " scene, more scenes of scenes like these."
        ]
    return [
        _intervals(table, tested),
        _resolved(table, table.reference),
        _power(table, tested),
        *_beside_the_paper(table),
    ]


def _intervals(table: Compared, tested: Sequence[Interval]) -> str:
    counted = sorted({(each["over"], each["units"]) for each in tested})
    scene = table.scenes[0] if len(table.scenes) == 1 else "one scene"
    texts = [population(over, units, scene) for over, units in counted]
    return f"Differences are paired by scene and seed, with 95 % t intervals {'; or '.join(texts)}."


def _resolved(table: Compared, reference: str) -> str:
    columns = [column for column in table.columns if column.smallest is not None]
    rate = min(1.0, ERROR_RATE * len(columns))
    told = (COLOURS if table.coloured else WORDS).format(reference=repr(table.texts[reference]))
    return (
        f"{told} Resolved: paired t tests with Holm's correction over the"
        f" rows of a column. If no rows differed, at most {100 * ERROR_RATE:.0f} % of columns would have a false"
        f" difference, and at most {100 * rate:.0f} % of tables of {count_of(len(columns), 'column')}."
    )


def _power(table: Compared, tested: Sequence[Interval]) -> str:
    smallest = [
        f"{column.label} {_printed(column.smallest, column.decimals)} {column.unit}".rstrip()
        for column in table.columns
        if column.smallest is not None
    ]
    over, units = min(((each["over"], each["units"]) for each in tested), key=lambda each: each[1])
    return (
        "The smallest true difference of a typical row that would be resolved in four of five runs like this one"
        f" ({count_of(units, over[:-1])}): {', '.join(smallest)}."
    )


def _printed(size: float, decimals: int) -> str:
    """A size with the column's decimals, or with two digits where all of those would be 0."""
    text = f"{size:.{decimals}f}"
    return text if float(text) else f"{size:.2g}"


def _beside_the_paper(table: Compared) -> list[str]:
    """The published differences, by whether this table would have resolved one of that size, and whether it did."""
    seen: dict[str, dict[str, list[str]]] = {}
    base = table.published.get(table.reference or "", {})
    for row, text in table.texts.items():
        for column in table.columns:
            value, difference = table.published.get(row, {}).get(column.key), table.differences[row].get(column.key)
            if value is None or difference is None or column.smallest is None or column.key not in base:
                continue
            told = value - base[column.key]
            outcome = _outcome(told, difference, column.smallest)
            seen.setdefault(outcome, {}).setdefault(text, []).append(f"{column.label} {signed(told, column.decimals)}")
    others = sorted({column.by for column in table.columns if column.by})
    by = f" (published by protocol {', '.join(others)})" if others else ""
    return [
        f"{outcome}{by}: {'; '.join(_listed(text, items) for text, items in seen[outcome].items())}."
        for outcome in OUTCOMES
        if outcome in seen
    ]


def _listed(text: str, items: Sequence[str]) -> str:
    return f"{text}: {', '.join(items)}"


OUTCOMES = SAME, OTHER, ABSENT, SMALL = (
    "The paper's differences that are resolved here with the same sign",
    "The paper's differences that are resolved here with the other sign",
    "Not resolved here, where the paper's difference would have been",
    "Not resolved here, where the paper's difference is too small for this table",
)


def _outcome(told: float, difference: Interval, smallest: float) -> str:
    if difference["p_value"] is not None and difference["p_value"] <= ERROR_RATE:
        return SAME if told * difference["mean"] > 0 else OTHER
    return ABSENT if abs(told) >= max(smallest, difference["smallest"] or 0.0) else SMALL
