"""Prints for all commands: results to stdout, errors to stderr."""

import shutil
import sys
from typing import TYPE_CHECKING

from .wrapping import wrapped

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

LOG_WIDTH = 160
"""Width in characters if stdout is a file or a pipe: a suite's table does not wrap."""


def say(line: str) -> None:
    """Print a line; on a terminal it is wrapped between words."""
    sys.stdout.write(fitted(line, sys.stdout.isatty()) + "\n")


def say_whole(line: str) -> None:
    """Print a line unchanged: what programs read."""
    sys.stdout.write(line + "\n")


def complain(message: str) -> None:
    """Print an error message, wrapped like other lines."""
    sys.stderr.write(fitted(message, sys.stderr.isatty()) + "\n")


def fitted(text: str, on_terminal: bool) -> str:
    """The text, wrapped to the width of a terminal if it is printed on one."""
    if not on_terminal:
        return text
    columns = shutil.get_terminal_size().columns
    return "\n".join(wrapped(line, columns) for line in text.split("\n"))


def show(table: "Table") -> None:
    """Print a table, as wide as the terminal if there is one."""
    console().print(table)


def console() -> "Console":
    """Where tables are printed."""
    from rich.console import Console  # not before something is shown: help and errors must answer at once

    return Console(width=None if sys.stdout.isatty() else LOG_WIDTH)
