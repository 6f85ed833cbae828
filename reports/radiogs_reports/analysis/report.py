"""Findings of an analysis: sentences, tables of derived values, and records. ``write`` and ``page`` show them."""

from collections.abc import Callable
from typing import NamedTuple

from ..statistics import Estimate
from ..wording import number, plus_minus, signed

UNKNOWN = "the results do not hold it"


class Item(NamedTuple):
    """A text in a grid and the value that it sorts by."""

    text: str
    value: float | str | None = None
    reason: str = UNKNOWN
    """Why the value is missing."""


class Grid(NamedTuple):
    """A table of derived values."""

    name: str
    """Its name in labels and on the page."""
    title: str
    note: str
    """How to read it."""
    heads: list[str]
    rows: list[list[Item]]


Record = dict[str, object]
"""A line of a CSV file: values with all of their digits, by the names of their columns."""


class Report(NamedTuple):
    """The findings of an analysis of a run."""

    sentences: list[str]
    grids: list[Grid]
    """The tables of the values in the sentences."""
    records: list[Record]


def name_item(text: str) -> Item:
    """An item that sorts by its text."""
    return Item(text, text)


def number_item(value: float | None, decimals: int = 0) -> Item:
    """A number without a sign and without an interval, or n/a."""
    return Item("n/a") if value is None else Item(number(value, decimals), value)


def plain_item(estimate: Estimate | None, decimals: int, reason: str = UNKNOWN) -> Item:
    """Mean without a sign and half-width of the interval, or n/a."""
    return estimate_item(estimate, decimals, reason, number)


def estimate_item(
    estimate: Estimate | None, decimals: int, reason: str = UNKNOWN, text_of: Callable[[float, int], str] = signed
) -> Item:
    """Mean, with its sign, and half-width of the interval, or n/a."""
    if estimate is None:
        return Item("n/a", None, reason)
    return Item(plus_minus(estimate.mean, estimate.half_width, decimals, text_of), estimate.mean)


def factor_item(estimate: Estimate | None, reason: str = UNKNOWN) -> Item:
    """A ratio and the ends of its interval, or n/a."""
    if estimate is None:
        return Item("n/a", None, reason)
    ends = "" if estimate.low is None else f" ({estimate.low:.2f} to {estimate.high:.2f})"
    return Item(f"{estimate.mean:.2f}{ends}", estimate.mean)


def share_item(estimate: Estimate | None, reason: str) -> Item:
    """A share in percent and the half-width of its interval, or n/a."""
    if estimate is None:
        return Item("n/a", None, reason)
    percent = None if estimate.half_width is None else 100 * estimate.half_width
    return Item(f"{plus_minus(100 * estimate.mean, percent, 1, number)} %", estimate.mean)


def estimate_fields(**estimates: Estimate | None) -> Record:
    """The mean of each estimate under its name, and the ends of its interval under ``name_low`` and ``name_high``."""
    fields: Record = {}
    for name, estimate in estimates.items():
        mean, low, high = (estimate.mean, estimate.low, estimate.high) if estimate else (None, None, None)
        fields |= {name: mean, f"{name}_low": low, f"{name}_high": high}
    return fields
