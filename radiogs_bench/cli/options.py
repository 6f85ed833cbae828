"""Shared by the commands' options: the parser, and the types of values."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from radiogs_core.errors import UsageError

if TYPE_CHECKING:
    from radiogs_core.transport.plan import Effects

    Commands = argparse._SubParsersAction["ExplainingParser"]


class ExplainingParser(argparse.ArgumentParser):
    """Reports wrong usage like every other error."""

    def error(self, message: str) -> NoReturn:
        """Raise UsageError instead of printing and exiting."""
        raise UsageError(message, self.format_usage().strip(), f"All options:  {self.prog} --help")


def names(text: str) -> list[str]:
    """A list separated by commas."""
    return [name for name in text.split(",") if name]


def effects(text: str) -> "Effects":
    """all, auto, or a list of effects separated by commas; ``none`` is the empty list."""
    from radiogs_core.transport.plan import checked_effects

    if text in ("all", "auto"):
        return text
    return checked_effects(() if text == "none" else names(text))


def add_effects(parser: argparse.ArgumentParser, default: str | None = "all") -> None:
    """Add ``--effects``, for commands that simulate light."""
    parser.add_argument(
        "--effects", type=effects, default=default, metavar="all|auto|LIST",
        help="what is simulated: all, those that the scene needs, or the effects that are on (default: all)",
    )  # fmt: skip


def positive(text: str) -> int:
    """A whole number above zero."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number above zero")
    return int(text)


def part_of(text: str) -> tuple[int, int]:
    """A part and the number of parts, such as 0/2."""
    number, _, count = text.partition("/")
    if not (number.isdecimal() and count.isdecimal() and int(number) < int(count)):
        raise argparse.ArgumentTypeError(f"'{text}' is not a part such as 0/2")
    return int(number), int(count)


def add_data(parser: argparse._ActionsContainer) -> None:
    """Add ``--data``, for commands that read scenes; ``main`` sets it."""
    parser.add_argument(
        "--data", type=Path, metavar="ROOT", help="folder of data sets (default: the variable RADIOGS_BENCH_DATA)"
    )


def add_verbose(parser: argparse.ArgumentParser) -> None:
    """Add ``--verbose``, which every command has."""
    parser.add_argument("--verbose", action="store_true", help="log what happens, and tracebacks of errors")
