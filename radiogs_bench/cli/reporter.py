"""Prints for all commands: results to stdout, errors to stderr."""

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

LOG_WIDTH = 160
"""Width in characters if stdout is a file or a pipe: a suite's table does not wrap."""


def say(line: str) -> None:
    """Print a line unchanged."""
    sys.stdout.write(line + "\n")


def complain(message: str) -> None:
    """Print an error message."""
    sys.stderr.write(message + "\n")


def show(table: "Table") -> None:
    """Print a table, as wide as the terminal if there is one."""
    console().print(table)


def console() -> "Console":
    """Where tables are printed."""
    from rich.console import Console  # not before something is shown: help and errors must answer at once

    return Console(width=None if sys.stdout.isatty() else LOG_WIDTH)
