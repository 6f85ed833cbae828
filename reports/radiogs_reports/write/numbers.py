"""Columns of numbers in LaTeX, aligned at the decimal point by siunitx, with a narrow column of text behind each."""

import re
from collections.abc import Iterable
from typing import NamedTuple

PLAIN = re.compile(r"([+-]?)(\d+)(?:\.(\d+))?")
"""What siunitx aligns; anything else, such as n/a or an exponent, is set as text in the middle of the column."""

SETUP = r"\sisetup{group-minimum-digits=9}"
"""In front of a tabular: digits are not grouped, so that a value is printed with the digits that it was given."""


class Entry(NamedTuple):
    """A number with what stands before it (size and colour) and behind it (LaTeX, in the narrow column)."""

    number: str = ""
    style: str = ""
    behind: str = ""

    def __bool__(self) -> bool:
        return bool(self.number or self.behind)

    def cells(self) -> str:
        """The two cells of a line."""
        aligned = PLAIN.fullmatch(self.number)
        number = f"{self.style}{self.number}" if aligned else f"{{{self.style}{self.number}}}" if self.number else ""
        return f"{number} & {self.behind}"


def layout(entries: Iterable[Entry]) -> str:
    """The two columns of some numbers: wide enough for the most digits on either side of the point, and a sign."""
    matches = [match for entry in entries if (match := PLAIN.fullmatch(entry.number))]
    whole = max((len(match[2]) for match in matches), default=1)
    decimals = max((len(match[3] or "") for match in matches), default=0)
    sign = "-" if any(match[1] for match in matches) else ""
    return rf"S[table-format={sign}{whole}.{decimals}]@{{\,}}l"


def line(label: str, entries: Iterable[Entry], *more: str) -> str:
    """A line of a table: what heads it, numbers, further cells."""
    return rf"{' & '.join([label, *(entry.cells() for entry in entries), *more])} \\"


def over(text: str) -> str:
    """A heading over the two columns of a number."""
    return rf"\multicolumn{{2}}{{c}}{{{text}}}"
