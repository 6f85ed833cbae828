"""The command line ``radiogs-bench``: parses options and prints."""

from .main import main

__all__ = ["main"]
