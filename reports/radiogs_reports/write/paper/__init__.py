"""The paper's tables with their own rows and columns: measured values beside published ones."""

from .latex import paper_latex
from .plain import paper_csv, paper_markdown

__all__ = ["paper_csv", "paper_latex", "paper_markdown"]
