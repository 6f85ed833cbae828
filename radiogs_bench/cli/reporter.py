"""All that the commands print: what was asked for to stdout, complaints to stderr."""

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table

LOG_WIDTH = 160
"""Columns where stdout is a file or a pipe: wide enough for a suite's table, so that nothing wraps."""


def say(line: str) -> None:
    """One line, as it is."""
    sys.stdout.write(line + "\n")


def complain(message: str) -> None:
    """An error message."""
    sys.stderr.write(message + "\n")


def show(table: "Table") -> None:
    """A table; as wide as the terminal, where there is one."""
    from rich.console import Console  # not before something is shown: help and errors must answer at once

    Console(width=None if sys.stdout.isatty() else LOG_WIDTH).print(table)
