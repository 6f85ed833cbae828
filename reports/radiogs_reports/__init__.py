"""Tables and figures of a run, made from stored results alone."""

from .run_folder import write_reports

__all__ = ["write_reports"]
