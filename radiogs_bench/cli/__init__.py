"""The command line ``radiogs-bench``; the only part of the harness that talks to people and knows the reports."""

from .main import main

__all__ = ["main"]
