"""Prints for all commands: results to stdout, errors to stderr. Control characters in stored texts are made visible."""

import logging
import shutil
import sys
import textwrap
import traceback
from typing import TYPE_CHECKING

from ..errors import visible

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from ..store.folder import Store

LOG_WIDTH = 160
"""Width in characters if stdout is a file or a pipe: a suite's table does not wrap."""

BEFORE_COMMAND = "  radiogs-bench "
"""The text between a sentence and a command to copy."""


def say(*lines: str) -> None:
    """Print lines; on a terminal each is wrapped between words."""
    for line in lines:
        sys.stdout.write(fitted(visible(line), sys.stdout.isatty()) + "\n")


def say_whole(line: str) -> None:
    """Print a line for programs, unwrapped."""
    sys.stdout.write(visible(line) + "\n")


def complain(message: str) -> None:
    """Print an error message, wrapped like other lines."""
    sys.stderr.write(fitted(visible(message), sys.stderr.isatty()) + "\n")


def complain_with_trace() -> None:
    """Print the traceback of the error that is being handled, unwrapped."""
    sys.stderr.write(visible(traceback.format_exc()))


class VisibleFormatter(logging.Formatter):
    """Log records as ``complain`` prints messages, unwrapped."""

    def format(self, record: logging.LogRecord) -> str:
        """The record as one visible text."""
        return visible(super().format(record))


def fitted(text: str, on_terminal: bool) -> str:
    """The text, wrapped to the terminal's width if stdout is a terminal."""
    if not on_terminal:
        return text
    columns = shutil.get_terminal_size().columns
    return "\n".join(wrapped(line, columns) for line in text.split("\n"))


def wrapped(line: str, width: int) -> str:
    """The line in lines of at most ``width`` characters; a longer word, and a command at the end, stay in one piece."""
    if len(line) <= width:
        return line
    sentence, before, command = line.partition(BEFORE_COMMAND)
    margin = line[: len(line) - len(line.lstrip())]
    lines = textwrap.wrap(
        sentence, width, subsequent_indent=margin, break_long_words=False, break_on_hyphens=False
    )  # fmt: skip
    return "\n".join([*lines, *([before + command] if before else [])])


def show(table: "Table", width: int | None = None) -> None:
    """Print a table, as wide as ``console``; into a file or a pipe as Markdown, unless a width is given."""
    if width is not None or sys.stdout.isatty():
        console(width).print(table)
    else:
        say(*in_markdown(table))


def in_markdown(table: "Table") -> list[str]:
    """A table, whose cells are text with rich's markup, as lines of Markdown below its title, one for each row."""
    from rich.text import Text

    from radiogs_reports.write.markdown import table_head, table_line

    title = [Text.from_markup(f"{table.title}").plain, ""] if table.title else []
    columns = ((column.header, *column.cells) for column in table.columns)
    head, *rows = zip(*([Text.from_markup(f"{cell}").plain for cell in column] for column in columns), strict=True)
    return [*title, *table_head(head), *map(table_line, rows)]


def console(width: int | None = None) -> "Console":
    """The console that tables are printed on: of ``width`` characters, else as wide as the terminal if there is one."""
    from ..runs.progress import TextConsole  # not before something is shown: help and errors must answer at once

    return TextConsole(width=width or (None if sys.stdout.isatty() else LOG_WIDTH))


def say_aside(store: "Store") -> None:
    """Print a line if files lie in OUT/aside."""
    from ..store.folder import ASIDE, kept_aside

    names = kept_aside(store.folder)
    if names:
        shown = ", ".join(names[:3]) + (" and others" if len(names) > 3 else "")
        files = "1 file was" if len(names) == 1 else f"{len(names)} files were"
        say(f"{files} found damaged and not used: {store.folder / ASIDE} has {shown}")
