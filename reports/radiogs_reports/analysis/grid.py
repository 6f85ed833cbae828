"""Tables of derived values: texts with the values that they sort by. ``write`` and ``page`` show them."""

from typing import NamedTuple

from ..statistics import Estimate
from ..wording import plus_minus, signed

UNKNOWN = "the results do not hold it"


class Item(NamedTuple):
    """A text in a grid and the value that it sorts by."""

    text: str
    value: float | str | None = None
    reason: str = UNKNOWN
    """Why there is no value."""


class Grid(NamedTuple):
    """A table of derived values."""

    name: str
    """Its name in labels and on the page."""
    title: str
    note: str
    """How to read it."""
    heads: list[str]
    rows: list[list[Item]]


def name_item(text: str) -> Item:
    """An item that sorts by its text."""
    return Item(text, text)


def plain_item(estimate: Estimate | None, decimals: int, reason: str = UNKNOWN) -> Item:
    """Mean without a sign and half-width of the interval, or n/a."""
    if estimate is None:
        return Item("n/a", None, reason)
    return Item(plus_minus(f"{estimate.mean:.{decimals}f}", estimate.half_width, decimals), estimate.mean)


def estimate_item(estimate: Estimate | None, decimals: int, reason: str = UNKNOWN) -> Item:
    """Signed mean and half-width of the interval, or n/a."""
    if estimate is None:
        return Item("n/a", None, reason)
    return Item(plus_minus(signed(estimate.mean, decimals), estimate.half_width, decimals), estimate.mean)


def factor_item(estimate: Estimate | None, reason: str = UNKNOWN) -> Item:
    """A ratio and the ends of its interval, or n/a."""
    if estimate is None:
        return Item("n/a", None, reason)
    if estimate.low is None or estimate.high is None:
        return Item(f"{estimate.mean:.2f}", estimate.mean)
    return Item(f"{estimate.mean:.2f} ({estimate.low:.2f} to {estimate.high:.2f})", estimate.mean)


def share_item(estimate: Estimate | None, reason: str = UNKNOWN) -> Item:
    """A share in percent and the half-width of its interval, or n/a."""
    if estimate is None:
        return Item("n/a", None, reason)
    percent = None if estimate.half_width is None else 100 * estimate.half_width
    return Item(f"{plus_minus(f'{100 * estimate.mean:.1f}', percent, 1)} %", estimate.mean)
