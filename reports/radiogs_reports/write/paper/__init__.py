"""The tables of the paper, with the same rows and columns: what was measured beside what was published."""

from .latex import paper_latex
from .plain import paper_csv, paper_markdown

__all__ = ["paper_csv", "paper_latex", "paper_markdown"]
