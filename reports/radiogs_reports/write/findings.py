"""A report of sentences and one grid, as Markdown and as LaTeX."""

from collections.abc import Sequence
from typing import Protocol

from ..analysis.grid import Grid
from ..summary import Summary
from .caption import run_note
from .document import itemized
from .grid import grid_latex, grid_markdown


class Findings(Protocol):
    """What an analysis found, in sentences, and the grid that shows it."""

    @property
    def sentences(self) -> Sequence[str]:
        """What was found, a sentence each."""

    @property
    def grid(self) -> Grid:
        """The values that the sentences are about."""


def findings_markdown(summary: Summary, title: str, found: Findings) -> str:
    """Sentences, then the table."""
    lines = [f"# {summary['title']}: {title}", "", *(f"- {each}" for each in found.sentences), ""]
    return "\n".join([*lines, *grid_markdown(found.grid), "", run_note(summary), ""])


def findings_latex(summary: Summary, title: str, found: Findings) -> str:
    """Sentences, then the table, to be input into a document with ``latex.PREAMBLE``."""
    lines = itemized(summary, f"{title[:1].upper()}{title[1:]}", found.sentences)
    return "\n".join([*lines, *grid_latex(found.grid), ""])
