"""Markdown tables, and text that stays text in them."""

from collections.abc import Sequence


def table_line(cells: Sequence[str]) -> str:
    """One line of a table."""
    return "| " + " | ".join(" ".join(cell.splitlines()).replace("|", "\\|") for cell in cells) + " |"


def listed(sentences: Sequence[str]) -> list[str]:
    """A list of sentences and the line below it; empty without any."""
    return [*(f"- {each}" for each in sentences), ""] if sentences else []


def table_head(cells: Sequence[str]) -> list[str]:
    """The heading line and the rule below it."""
    return [table_line(cells), table_line(["---"] * len(cells))]


def without_markup(document: str) -> str:
    """A document without HTML tags, links and pictures: no report has any, so they come from names and titles."""
    return document.replace("<", "&lt;").replace("](", "]\\(")
