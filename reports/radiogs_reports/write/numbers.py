"""Tables of numbers in LaTeX, aligned at the decimal point by siunitx, with a narrow column of text behind each."""

import re
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from ..tables.model import Difference, Table
from .latex import LEFT, as_formula, escape, legend, negative, note_mark, tabular

PLAIN = re.compile(r"([+-]?)(\d+)(?:\.(\d+))?")
"""Numbers that siunitx aligns; anything else, such as n/a or an exponent, is text in the middle of the column."""

SETUP = r"\sisetup{group-minimum-digits=9,retain-explicit-plus=true}"
"""LaTeX before a tabular: digits are not grouped, a gain keeps its plus, and numbers are printed as given."""

MOST_ACROSS = 6
"""Most numbers side by side; more continue in a tabular below, because print would make them too small to read."""

MOST_LINES = 40
"""Most lines of a table on one page, without its heads; further parts are a table of their own."""


class Entry(NamedTuple):
    """A number in a table."""

    number: str = ""
    style: str = ""
    """LaTeX before it: size and colour."""
    behind: str = ""
    """LaTeX after it, in the narrow column."""

    def __bool__(self) -> bool:
        return bool(self.number or self.behind)

    def cells(self) -> str:
        """The two cells of a line."""
        aligned = PLAIN.fullmatch(self.number)
        number = f"{self.style}{self.number}" if aligned else f"{{{self.style}{self.number}}}" if self.number else ""
        return f"{number} & {self.behind}"


def difference_entry(difference: Difference | None) -> Entry:
    """A paired difference with the half-width of its interval, in small print; empty without one."""
    if difference is None:
        return Entry()
    behind = rf"\scriptsize $\pm${difference.half_width}" if difference.half_width else ""
    return Entry(difference.text, r"\scriptsize ", behind)


def layout(entries: Iterable[Entry]) -> str:
    """The two columns of some numbers: wide enough for the most digits on either side of the point, and a sign."""
    matches = [match for entry in entries if (match := PLAIN.fullmatch(entry.number))]
    whole = max((len(match[2]) for match in matches), default=1)
    decimals = max((len(match[3] or "") for match in matches), default=0)
    sign = "-" if any(match[1] for match in matches) else ""
    return rf"S[table-format={sign}{whole}.{decimals}]@{{\,}}l"


class TabularLine(NamedTuple):
    """A line of a table."""

    label: str
    """LaTeX before the numbers, with the separators of its cells."""
    entries: Sequence[Entry]

    def cut(self, part: slice) -> "TabularLine":
        """The line of some of the columns."""
        return TabularLine(self.label, self.entries[part])

    def text(self) -> str:
        """The line of a tabular."""
        return rf"{' & '.join([self.label, *(entry.cells() for entry in self.entries)])} \\"


class Group(NamedTuple):
    """Lines that belong together, the first of which is always printed; a rule precedes a group with a title."""

    lines: Sequence[TabularLine]
    title: str = ""

    def cut(self, part: slice) -> "Group":
        """The group with some of the columns, without further lines that have no entry in them."""
        first, *others = (line.cut(part) for line in self.lines)
        kept = [line for line in others if any(line.entries)]
        return Group([first, *kept] if kept or any(first.entries) or not self.title else [], self.title)


def over(text: str) -> str:
    """A heading over the two columns of a number."""
    return rf"\multicolumn{{2}}{{c}}{{{text}}}"


def parts(count: int) -> list[slice]:
    """Columns in their order, cut into as few parts of nearly equal size as fit."""
    number = -(-count // MOST_ACROSS)
    across = -(-count // number)
    return [slice(start, min(start + across, count)) for start in range(0, count, across)]


def tabulars(lead: str, label: str, heads: Callable[[slice], Sequence[str]], groups: Sequence[Group]) -> list[str]:
    """Tabulars below each other, one of each part of the columns, within a table environment.

    ``lead``: layout of the columns of the labels. ``label``: the table's, for the heads of its continuations.
    """
    lines, held = [r"\small"], 0
    for part in parts(len(groups[0].lines[0].entries)):
        cut = [group.cut(part) for group in groups]
        height = sum(len(group.lines) for group in cut)
        if held and held + height > MOST_LINES:
            lines += [r"\end{table}", r"\begin{table}[tbp]", r"\centering", SETUP, r"\small"]
            lines += [rf"Table~\ref{{{label}}}, continued", r"\par"]
            held = 0
        lines += [r"\par"] * (held > 0)
        held += height
        columns = zip(*(line.entries for group in cut for line in group.lines), strict=True)
        aligned = "".join(map(layout, columns))
        body = _body([group for group in cut if group.lines], len(lead) + 2 * (part.stop - part.start))
        lines += tabular(lead + aligned, heads(part), body)
    return lines


def _body(groups: Sequence[Group], across: int) -> list[str]:
    """Groups with space between them, if any has more than a line, so that a line is not read as the next group's."""
    apart = any(len(group.lines) > 1 for group in groups)
    lines = []
    for place, group in enumerate(groups):
        if group.title:
            lines += [r"\midrule", rf"\multicolumn{{{across}}}{{l}}{{{group.title}}} \\"]
        else:
            lines += [r"\addlinespace"] * (place > 0 and apart)
        lines += [line.text() for line in group.lines]
    return lines


def environment(
    table: Table, label: str, caption: str, lead: str, heads: Callable[[slice], Sequence[str]], groups: Sequence[Group]
) -> list[str]:
    """The table environment with its caption (LaTeX) and headline, tabulars, notes and legend; parameters as in
    ``tabulars``."""
    notes = (rf"{note_mark(index)} {as_formula(note)}." for index, note in enumerate(table.notes))
    return [
        f"% {escape(f'{table.name}: {table.source}')}",
        r"\begin{table}[tbp]",
        r"\centering",
        SETUP,
        f"\\caption{{{' '.join([caption, *map(negative, table.headline)])}}}",
        f"\\label{{{label}}}",
        *tabulars(lead, label, heads, groups),
        LEFT,
        *(rf"\par\smallskip\footnotesize {note}" for note in notes),
        *legend(table.legend),
        r"\end{table}",
    ]
