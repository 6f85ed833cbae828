"""A table of values in which everything is decided: LaTeX, Markdown, the page and the terminal only draw it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..analysis.comparisons import Direction, ordered
from ..analysis.findings import Sentence
from ..summary import CellSummary, Interval, RecordedCell, Verdict, half_width
from ..wording import ARROWS, number, shared_decimals, signed


@dataclass(frozen=True)
class Column:
    """The heading of a column, and how its values are printed."""

    label: str
    """In full, such as ``NVS PSNR``."""
    unit: str = ""
    direction: Direction = "none"
    """Which values are better."""
    decimals: int = 0
    """Printed decimals."""
    key: str = ""
    group: str = ""
    """The heading that it shares with its neighbours; empty in the suite's table."""
    name: str = ""
    """Its heading below ``group``."""
    published_by: str = ""
    """The protocol of its published values, where its conventions are others than the run's; else empty."""
    smallest: float | None = None
    """The smallest difference that the run could have resolved in it (``analysis.power``); None without intervals."""
    meaning: str = ""
    """Definition of the metric, in words."""
    numeric: bool = True
    """Whether it sorts by number and is aligned right."""

    @property
    def arrow(self) -> str:
        """The arrow towards better values; empty for a column without a direction."""
        return ARROWS[self.direction]

    @property
    def heading(self) -> str:
        """Label, arrow and unit in one line: ``NVS PSNR ↑ (dB)``."""
        unit = f"({self.unit})" if self.unit else ""
        return " ".join(part for part in (self.label, self.arrow, unit) if part)


@dataclass(frozen=True)
class Difference:
    """A paired difference to the reference row, with the texts of its mean and of its 95 % interval."""

    interval: Interval
    text: str
    """The mean with its sign."""
    half_width: str
    """Half the length of the interval; empty for one unit, like ``low`` and ``high``."""
    low: str
    high: str
    verdict: Verdict | None
    """Which row is better, shown as a colour or a word; None if unresolved, or if a footnote concerns either value."""

    @property
    def plus_minus(self) -> str:
        """The mean and the half-width of the interval: ``-1.23 ± 0.50``."""
        return f"{self.text} ± {self.half_width}" if self.half_width else self.text


def difference_of(interval: Interval | None, decimals: int, verdict: Verdict | None) -> Difference | None:
    """A difference with its column's decimals, or as many as half its interval needs; None without a difference."""
    if interval is None:
        return None
    width, low, high = half_width(interval), interval["low"], interval["high"]
    decimals = decimals if width is None else shared_decimals([width], decimals)
    return Difference(
        interval,
        signed(interval["mean"], decimals),
        "" if width is None else number(width, decimals),
        "" if low is None else signed(low, decimals),
        "" if high is None else signed(high, decimals),
        verdict,
    )


@dataclass(frozen=True)
class PrintedCell:
    """A value as printed, with everything that is printed beside it."""

    text: str
    """The value with its column's decimals; ``n/a`` for a missing value."""
    value: float | str | None
    """The value that it sorts by: its magnitude if zero is best; None for a missing value."""
    reason: str = ""
    """Why the value is missing."""
    marks: str = ""
    """The marks of its footnotes."""
    rank: str = ""
    """Its rank among the rows, in words; empty for a row that was not compared."""
    difference: Difference | None = None
    """None in the reference row, and without a comparison."""
    published: "PrintedCell | None" = None
    """The published value beside it; None if the table prints none there."""
    apart: "PrintedCell | None" = None
    """The published value by other conventions, which must not be compared with it."""

    @property
    def verdict(self) -> Verdict | None:
        """The verdict of its difference."""
        return self.difference.verdict if self.difference else None


def missing_cell(reason: str | None) -> PrintedCell:
    """A cell without a value."""
    return PrintedCell("n/a", None, reason or "not measured")


def rank_in_words(rank: int | None) -> str:
    """How many rows are resolved to be better (``comparisons.ranks``); empty for a row that was not compared."""
    if rank is None or rank == 1:
        return "" if rank is None else "no row resolved to be better"
    rows = "1 row" if rank == 2 else f"{rank - 1} rows"
    return f"{rows} resolved to be better than this one, or than one with a better mean"


def stored_ranks(
    cells: Mapping[str, Mapping[str, CellSummary | RecordedCell]], key: str, direction: Direction
) -> dict[str, int]:
    """Ranks of a column by row, in the order of means, which records of earlier versions do not keep."""
    ranked, means = {}, {}
    for row, stored in cells.items():
        cell = stored.get(key)
        if cell and (rank := cell.get("rank")) is not None and cell["mean"] is not None:
            ranked[row], means[row] = rank, cell["mean"]
    return ordered(ranked, means, direction)


@dataclass(frozen=True)
class PrintedRow:
    """A row's label and its cells, one for each column."""

    text: str
    """Its label in plain text."""
    cells: Sequence[PrintedCell]
    key: str = ""
    latex: str = ""
    """Its label in LaTeX; empty if it is ``text``, escaped."""
    ran: str = ""
    """Label of the measured row if it is not the paper's row; else empty."""
    remark: str = ""
    """How to read the paper's values of this row."""
    opens: str = ""
    """Key of the run whose provenance its label opens on the page."""
    page: str = ""
    """Address of the page that its label opens in a site."""

    @property
    def measured_label(self) -> str:
        """The label of its measured values."""
        return self.ran or self.text

    @property
    def published_label(self) -> str:
        """The label of published values below the measured ones; empty if it would repeat the measured label."""
        return self.text if self.ran else ""

    @property
    def has_published(self) -> bool:
        """Whether published values are printed beside the measured ones."""
        return any(cell.published is not None for cell in self.cells)


@dataclass(frozen=True)
class Table:
    """A table with all of its sentences."""

    name: str
    """Part of file names, labels and references."""
    title: str
    columns: Sequence[Column]
    rows: Sequence[PrintedRow]
    caption: str = ""
    """The conditions of its values, in plain text."""
    lead: str = "row"
    """The heading of the labels."""
    source: str = ""
    """Where the table comes from, for a comment in its file."""
    reference: PrintedRow | None = None
    """The row that differences are taken to."""
    published_data: str = ""
    """The data that published values are averaged over."""
    apart_title: str = ""
    """The heading of published values by other conventions; empty if there are none."""
    headline: Sequence[str] = ()
    """Its main findings, in a sentence or two."""
    findings: Sequence[Sentence] = ()
    """Its findings, which are printed above it: resolved differences, unresolved ones, and the paper's differences."""
    legend: Sequence[str] = ()
    """How the table is read, where colours show what is resolved."""
    legend_in_words: Sequence[str] = ()
    """How the table is read, where words show what is resolved."""
    notes: Sequence[str] = ()
    """Why values are missing, and remarks on rows, without a full stop: each once, in the order of the table."""
    footnotes: Sequence[str] = ()
    """Doubts about single values, each behind the mark that the values have."""
    remarks: Sequence[str] = ()
    """Remarks on methods and recipes, which concern no column."""

    def note(self, text: str) -> int:
        """The index of a reason or remark among ``notes``."""
        return self.notes.index(text.rstrip("."))

    @property
    def cells(self) -> list[PrintedCell]:
        """All cells, row by row."""
        return [cell for row in self.rows for cell in row.cells]

    @property
    def reasons(self) -> list[str]:
        """Why cells are n/a, each reason once, without a full stop."""
        return list(dict.fromkeys(cell.reason.rstrip(".") for cell in self.cells if cell.value is None))

    @property
    def missing(self) -> dict[str, list[str]]:
        """Labels of the columns in which values are missing, by reason."""
        found: dict[str, list[str]] = {}
        for place, column in enumerate(self.columns):
            for reason in (cell.reason for row in self.rows if (cell := row.cells[place]).value is None):
                if column.label not in found.setdefault(reason, []):
                    found[reason].append(column.label)
        return found

    @property
    def published_columns(self) -> list[int]:
        """Indices of the columns with a published value beside a measured one."""
        return [
            place
            for place in range(len(self.columns))
            if any((beside := row.cells[place].published) is not None and beside.value is not None for row in self.rows)
        ]

    @property
    def differences(self) -> dict[tuple[str, str], Difference]:
        """The differences to the reference row, by the keys of their row and column."""
        return {
            (row.key, column.key): cell.difference
            for row in self.rows
            for column, cell in zip(self.columns, row.cells, strict=True)
            if cell.difference is not None
        }
