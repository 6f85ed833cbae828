"""Markdown tables."""

from collections.abc import Sequence


def table_line(cells: Sequence[str]) -> str:
    """One line of a table."""
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def table_head(cells: Sequence[str]) -> list[str]:
    """The heading line and the rule below it."""
    return [table_line(cells), table_line(["---"] * len(cells))]
