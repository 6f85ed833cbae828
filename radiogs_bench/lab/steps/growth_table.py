"""Growth of seconds and bytes in words, on the terminal, and whether it is what is expected."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from .record import milliseconds

if TYPE_CHECKING:
    from rich.table import Table

FLAT = "flat"
"""The exponent of what hardly grows over the measured sizes."""


def within(row: Mapping[str, Any]) -> bool | None:
    """Whether seconds grow no faster than expected between the last two sizes, as far as the interval tells; None where
    nothing is expected, and without an interval."""
    last = row["last exponent"]
    if row["at most"] is None or last is None or last["low"] is None:
        return None
    return bool(last["low"] <= row["at most"])


def constant_said(row: Mapping[str, Any]) -> str:
    """Seconds that do not grow; empty for too few sizes."""
    return "" if row["law"] is None else milliseconds(row["law"]["constant"]["value"])


def exponent_said(row: Mapping[str, Any]) -> str:
    """The exponent of the part that grows, with its interval; empty for too few sizes."""
    law = row["law"]
    return "" if law is None else FLAT if law["exponent"] is None else ranged(law["exponent"])


def ranged(exponent: Mapping[str, float | None] | None) -> str:
    """An exponent with its interval, where it has one."""
    if exponent is None:
        return "n/a"
    low, high = exponent["low"], exponent["high"]
    return f"{exponent['value']:.2f}" + ("" if low is None or high is None else f" ({low:.2f} to {high:.2f})")


def growth_table(rows: Sequence[Mapping[str, Any]]) -> "Table":
    """A line for each thing and what grows."""
    from rich.table import Table

    table = Table("", "grows", "from", "to", "seconds from", "to", "constant", "exponent", "at the end", "of bytes")
    for row in rows:
        of_bytes = row["last exponent of bytes"]
        table.add_row(
            row["title"], row["grows"], f"{row['values'][0]:,}", f"{row['values'][-1]:,}",
            milliseconds(row["seconds"][0]), milliseconds(row["seconds"][-1]), constant_said(row), exponent_said(row),
            ranged(row["last exponent"]), "n/a" if of_bytes is None else f"{of_bytes:.2f}",
        )  # fmt: skip
    return table
