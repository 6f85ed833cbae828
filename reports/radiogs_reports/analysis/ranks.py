"""Ranks of rows in a column, taken from the values as printed, so that equal print has equal rank."""

from collections.abc import Mapping
from typing import Literal

from ..summary import ColumnSummary, Summary


def ranked(printed: Mapping[str, float], direction: Literal["up", "down", "zero"]) -> dict[str, int]:
    """Rank from 1 by row key; ties share the better rank, and the next value has the next rank."""
    compared = {key: abs(value) if direction == "zero" else value for key, value in printed.items()}
    order = sorted(set(compared.values()), reverse=direction == "up")
    return {key: order.index(value) + 1 for key, value in compared.items()}


def suite_ranks(summary: Summary, column: ColumnSummary) -> dict[str, int]:
    """Ranks of the rows with a value; empty without a reference row, where rows are not variants of one method."""
    if summary["reference"] is None:
        return {}
    cells = {row["key"]: summary["cells"][row["key"]][column["key"]]["mean"] for row in summary["rows"]}
    printed = {key: round(mean, column["decimals"]) for key, mean in cells.items() if mean is not None}
    return ranked(printed, column["direction"])
