"""What the commands' options share: the parser that explains itself, and the types of values."""

import argparse
from typing import TYPE_CHECKING, NoReturn

from radiogs.errors import UsageError

if TYPE_CHECKING:
    Commands = argparse._SubParsersAction["ExplainingParser"]


class ExplainingParser(argparse.ArgumentParser):
    """Reports wrong usage as every other error of the program is reported."""

    def error(self, message: str) -> NoReturn:
        """Raise UsageError instead of printing and leaving."""
        raise UsageError(message, self.format_usage().strip(), f"All options:  {self.prog} --help")


def names(text: str) -> list[str]:
    """A list separated by commas."""
    return [name for name in text.split(",") if name]


def positive(text: str) -> int:
    """A whole number above zero."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number above zero")
    return int(text)


def part_of(text: str) -> tuple[int, int]:
    """Which part of how many, such as 0/2."""
    number, _, count = text.partition("/")
    if not (number.isdecimal() and count.isdecimal() and int(number) < int(count)):
        raise argparse.ArgumentTypeError(f"'{text}' is not a part such as 0/2")
    return int(number), int(count)


def add_verbose(parser: argparse.ArgumentParser) -> None:
    """The option that every command has."""
    parser.add_argument("--verbose", action="store_true", help="log what happens, and tracebacks of errors")
