"""The suite's own table: means, paired differences and published values."""

from .latex import suite_document, suite_latex
from .plain import suite_csv, suite_markdown

__all__ = ["suite_csv", "suite_document", "suite_latex", "suite_markdown"]
