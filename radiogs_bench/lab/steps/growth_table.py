"""Exponents of growth on the terminal, and whether they are what is expected."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from .record import milliseconds

if TYPE_CHECKING:
    from rich.table import Table


def within(row: Mapping[str, Any]) -> bool | None:
    """Whether seconds grow no faster than expected, as far as the interval tells; None where nothing is expected."""
    exponent = row["seconds exponent"]
    if row["at most"] is None or exponent is None:
        return None
    low = exponent["value"] if exponent["low"] is None else exponent["low"]
    return bool(low <= row["at most"])


def growth_table(rows: Sequence[Mapping[str, Any]]) -> "Table":
    """A line for each thing and what grows."""
    from rich.table import Table

    table = Table("", "grows", "from", "to", "seconds from", "to", "exponent", "95 % interval", "exponent of bytes")
    for row in rows:
        found = row["seconds exponent"]
        between = "" if found["low"] is None else f"{found['low']:.2f} to {found['high']:.2f}"
        of_bytes = row["bytes exponent"]
        table.add_row(
            row["title"], row["grows"], f"{row['values'][0]:,}", f"{row['values'][-1]:,}",
            milliseconds(row["seconds"][0]), milliseconds(row["seconds"][-1]), f"{found['value']:.2f}", between,
            "n/a" if of_bytes is None else f"{of_bytes['value']:.2f}",
        )  # fmt: skip
    return table
