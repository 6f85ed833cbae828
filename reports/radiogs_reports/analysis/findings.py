"""The findings of a table: the resolved differences to the reference row, unresolved ones that the run could have
resolved, and the paper's differences; as records and as sentences.

A published difference is a row's published value minus the reference row's, so it has the sign of the measured
difference. Its sign holds if the measured difference is resolved in the same direction.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Literal, NamedTuple, cast, get_args

from ..summary import (
    CellSummary,
    ColumnSummary,
    Interval,
    PaperColumn,
    PaperTable,
    PaperValue,
    RecordedCell,
    RecordedRun,
    RowSummary,
    Summary,
    counted_scenes,
    is_doubted,
)
from ..wording import count_of, number, shared_decimals
from .comparisons import upwards

Outcome = Literal["holds", "does not hold", "not resolved"]


class MeasuredDifference(NamedTuple):
    """A row's difference to the reference row in a column, by their keys, and the paper's beside it."""

    row: str
    column: str
    difference: Interval
    """The measured difference, row minus reference row, in the unit of the column."""
    resolved: bool
    """Whether the table shows it as resolved (Holm's correction); False if a footnote concerns either value."""
    smallest: float | None
    """The smallest true difference of this row that four of five such runs resolve; None for one scene and seed."""
    published: float | None
    """The paper's difference; None if the paper lacks a value of either row."""
    verdict: Outcome | None
    """Whether the paper's sign holds; None without a published difference, if it is zero, or if doubted."""
    doubted: bool = False
    """Whether a footnote concerns either value; sentences leave such differences out."""

    @property
    def too_small(self) -> bool:
        """Whether this run was too small to resolve a difference of the paper's size, and resolved none."""
        if self.verdict != "not resolved" or self.published is None or self.smallest is None:
            return False
        return abs(self.published) < self.smallest

    @property
    def excluded(self) -> bool:
        """Whether the interval excludes the paper's difference, which was not too small for this run."""
        low, high = self.difference["low"], self.difference["high"]
        if self.doubted or self.too_small or self.published is None or low is None or high is None:
            return False
        return not low <= self.published <= high


class Sentence(NamedTuple):
    """A sentence on the findings."""

    text: str
    """The sentence, without the label of its row."""
    row: str = ""
    """Label of the row that it is about, in plain text; empty if it is about the table."""
    latex: str = ""
    """The row's label in LaTeX; empty if it is ``row``, escaped."""

    @property
    def plain(self) -> str:
        """The whole sentence in plain text."""
        return f"{self.row}, {self.text}" if self.row else self.text


class ComparedTable(NamedTuple):
    """A table with the rows that may be compared with its reference row. Values are by row, then column."""

    reference: str | None
    rows: Sequence[RowSummary]
    columns: Sequence[ColumnSummary]
    cells: Mapping[str, Mapping[str, CellSummary | PaperValue | RecordedCell]]
    published: Mapping[str, Mapping[str, float]]
    published_data: str
    scenes: Sequence[str]
    doubted: set[tuple[str, str]]
    """Rows and columns of values that a footnote concerns, directly or through the reference row's value."""


def compared_run(run: Summary | RecordedRun) -> ComparedTable:
    """The table of a run's suite, or of a recorded run."""
    if "runs" in run:
        doubted = _doubted(cast(Summary, run), run["rows"], run["columns"])
    else:
        doubted = {(row, key) for row, cells in run["cells"].items() for key, cell in cells.items() if cell["doubted"]}
    return ComparedTable(
        run["reference"], run["rows"], run["columns"], run["cells"], run["published"], run["published_data"],
        counted_scenes(run), doubted,
    )  # fmt: skip


def compared_paper(table: PaperTable, summary: Summary) -> ComparedTable:
    """A table of the paper, with its own reference row, without settings, in which no value is better."""
    columns: list[PaperColumn] = [
        {**each, "label": f"{each['group']} {each['label']}".strip()}
        for each in table["columns"]
        if each["direction"] != "none"
    ]
    rows = [RowSummary(key=each["key"], latex="", text=each["text"], seconds=None) for each in table["rows"]]
    published = {
        row: {key: float(value["published"]) for key, value in cells.items() if value["published"] is not None}
        for row, cells in table["cells"].items()
    }
    return ComparedTable(
        table["reference"], rows, columns, table["cells"], published, table["data"], counted_scenes(summary),
        _doubted(summary, rows, columns),
    )  # fmt: skip


def _doubted(summary: Summary, rows: Sequence[RowSummary], columns: Sequence[ColumnSummary]) -> set[tuple[str, str]]:
    places = ((row["key"], column["key"]) for row in rows for column in columns)
    return {(row, column) for row, column in places if is_doubted(summary, row, column)}


def differences_of(table: ComparedTable) -> list[MeasuredDifference]:
    """Every measured difference of a table, row by row; empty without a reference row."""
    if table.reference is None:
        return []
    return [
        _measured_difference(table, row["key"], table.reference, column, difference)
        for row in table.rows
        for column in table.columns
        if (difference := table.cells[row["key"]][column["key"]]["difference"]) is not None
    ]


def _measured_difference(
    table: ComparedTable, row: str, reference: str, column: ColumnSummary, difference: Interval
) -> MeasuredDifference:
    key = column["key"]
    theirs, base = (table.published.get(each, {}).get(key) for each in (row, reference))
    doubted = (row, key) in table.doubted
    published, outcome = None, None
    if theirs is not None and base is not None:
        published = theirs - base
        upward = upwards({"row": theirs, "reference": base}, column["direction"])
        outcome = None if doubted else _outcome(upward["row"] - upward["reference"], difference)
    resolved = difference["verdict"] is not None and not doubted
    return MeasuredDifference(row, key, difference, resolved, difference["smallest"], published, outcome, doubted)


def _outcome(gain: float, difference: Interval) -> Outcome | None:
    if gain == 0:
        return None
    if difference["verdict"] is None:
        return "not resolved"
    return "holds" if (gain > 0) == (difference["verdict"] == "better") else "does not hold"


def sentences_of(table: ComparedTable) -> list[Sentence]:
    """The findings of a table: the counts, how to read the rest, then each row's; empty without any."""
    found = differences_of(table)
    counted = [each for each in found if not each.doubted]
    made = [*_counts(counted), *_how_to_read(table, counted)]
    for row in table.rows:
        made += _of_row(table, row, [each for each in counted if each.row == row["key"]])
    return [*made, *_left_out(table, [each for each in found if each.doubted])]


def headline(table: ComparedTable) -> list[str]:
    """The main findings of a table in plain words: resolved and unresolved differences of the first compared row to the
    reference row; then the counts over all rows."""
    counted = [each for each in differences_of(table) if not each.doubted]
    counts = [each.text for each in _counts(counted)]
    first = [each for each in counted if each.row == counted[0].row and each.difference["units"] > 1]
    if not first or table.reference is None:
        return counts
    labels = {each["key"]: each["text"] for each in table.rows}
    columns = {each["key"]: each for each in table.columns}
    row, reference = labels[first[0].row], labels[table.reference]
    told: dict[str | None, list[str]] = {"worse": [], "better": [], None: []}
    for each in first:
        told[each.difference["verdict"] if each.resolved else None].append(_in_words(columns[each.column], each))
    alike = ", ".join(told.pop(None))
    said = " and ".join(f"{verdict} than {reference} by {', '.join(sizes)}" for verdict, sizes in told.items() if sizes)
    known = [f"{row} is {said}."] if said else []
    pair = "them" if said else f"{row} and {reference}"
    return [" ".join([*known, *([f"This run could not tell {pair} apart in {alike}."] if alike else [])]), *counts]


def _in_words(column: ColumnSummary, found: MeasuredDifference) -> str:
    """A resolved difference by its size, ``0.31 dB of NVS PSNR (0.20 to 0.42; paper 2.04)``, another by its metric."""
    (mean, low, high), published = (found.difference[name] for name in ("mean", "low", "high")), found.published
    if not found.resolved or mean is None or low is None or high is None:
        paper = "" if published is None else f" (paper {number(published, column['decimals'], '+')})"
        return f"{column['label']}{paper}"
    sizes = [abs(mean), *sorted((abs(low), abs(high)))]
    size, *ends = (number(each, shared_decimals(sizes, column["decimals"])) for each in sizes)
    other = " the other way" if found.verdict == "does not hold" else ""
    paper = "" if published is None else f"; paper {number(abs(published), column['decimals'])}{other}"
    return f"{' '.join([size, column['unit']]).rstrip()} of {column['label']} ({' to '.join(ends)}{paper})"


def _counts(counted: Sequence[MeasuredDifference]) -> Iterator[Sentence]:
    if not counted:
        return
    if all(each.difference["units"] == 1 for each in counted):
        yield Sentence("One scene and one seed: no difference can be resolved.")
        return
    resolved = sum(each.resolved for each in counted)
    verdicts = [each.verdict for each in counted if each.verdict is not None]
    holds, turned, open_ = (verdicts.count(each) for each in get_args(Outcome))
    signs = (
        f"; the paper's sign holds in {holds}, does not hold in {turned}, and is not resolved in {open_} of the"
        f" {count_of(len(verdicts), 'difference')} that the paper reports"
    )
    yield Sentence(
        f"{resolved} of {count_of(len(counted), 'difference')} {'is' if resolved == 1 else 'are'} resolved"
        f" (larger than chance explains){signs if verdicts else ''}."
    )


def _how_to_read(table: ComparedTable, counted: Sequence[MeasuredDifference]) -> Iterator[Sentence]:
    if any(each.smallest is not None for each in counted):
        yield Sentence(HOW_TO_READ)
    reported = {each.column for each in counted if each.published is not None}
    if reported:
        few = len(table.scenes) <= MOST_NAMED
        measured = ", ".join(table.scenes) if few else count_of(len(table.scenes), "scene")
        conventions = _conventions(table, reported)
        yield Sentence(f"Paper: its difference, on {table.published_data} (here on {measured}){conventions}.")


HOW_TO_READ = (
    "In square brackets: 95 % intervals; could show: the smallest true difference that four of five such runs resolve."
)

MOST_NAMED = 4
"""Most scenes that a sentence names."""


def _conventions(table: ComparedTable, reported: set[str]) -> str:
    """The protocol of published values where its conventions are others than the run's, and the columns."""
    columns = [each for each in table.columns if each["key"] in reported]
    apart = [each for each in columns if "published_by" in each]
    if not apart:
        return ""
    protocols = ", ".join(sorted({each["published_by"] for each in apart}))
    where = "" if len(apart) == len(columns) else f" in {', '.join(each['label'] for each in apart)}"
    return f", by other conventions (protocol {protocols}){where}"


def _of_row(table: ComparedTable, row: RowSummary, found: Sequence[MeasuredDifference]) -> Iterator[Sentence]:
    """A sentence on the resolved differences of a row, and one on the others."""
    columns = {each["key"]: each for each in table.columns}
    own = [(columns[each.column], each) for each in found]
    told = [each for each in own if each[1].resolved]
    if told:
        text = "; ".join(_entry(*each) for each in told)
        yield Sentence(f"resolved: {text}.", row["text"], row["latex"])
    others = [each for each in own if not each[1].resolved]
    if others:
        text = f"not resolved: {'; '.join(_entry(*each) for each in others)}."
        yield Sentence(" ".join([text, *_sizes(others)]), row["text"], row["latex"])


def _sizes(others: Sequence[tuple[ColumnSummary, MeasuredDifference]]) -> Iterator[str]:
    """The columns for whose published difference the run was too small, and the columns whose interval excludes it."""
    small = [column["label"] for column, each in others if each.too_small]
    if small:
        yield f"Too small for this run at the paper's size: {', '.join(small)}."
    excluded = [column["label"] for column, each in others if each.excluded and each.verdict is not None]
    if excluded:
        yield f"The interval excludes the paper's size: {', '.join(excluded)}."


def _entry(column: ColumnSummary, found: MeasuredDifference) -> str:
    """``NVS PSNR -1.23 dB [-1.73, -0.73] (paper -2.04, sign holds)``."""
    decimals, remarks = column["decimals"], []
    if not found.resolved and found.smallest is not None:
        remarks.append(f"could show {number(found.smallest, decimals)}")
        low, high = found.difference["low"], found.difference["high"]
        if low is not None and high is not None and low * high > 0:
            remarks.append("excludes zero alone, not after correction for all rows")
    if found.published is not None:
        remarks.append(f"paper {number(found.published, decimals, '+')}")
    if found.resolved and found.verdict is not None:
        remarks.append(f"sign {found.verdict}")
    behind = f" ({', '.join(remarks)})" if remarks else ""
    return f"{column['label']}{measured(column, found.difference)}{behind}"


def measured(column: ColumnSummary, difference: Interval) -> str:
    """A difference with its unit and its interval, if it has one."""
    values = [each for each in (difference["mean"], difference["low"], difference["high"]) if each is not None]
    decimals = shared_decimals(values, column["decimals"])
    mean, *ends = (number(each, decimals, "+") for each in values)
    parts = [mean, column["unit"], f"[{', '.join(ends)}]" if ends else ""]
    return "".join(f" {part}" for part in parts if part)


def _left_out(table: ComparedTable, doubted: Sequence[MeasuredDifference]) -> Iterator[Sentence]:
    counts = Counter(each.column for each in doubted)
    columns = [each for each in table.columns if each["key"] in counts]
    named = [f"{count_of(counts[each['key']], 'difference')} of {each['label']}" for each in columns]
    if named:
        yield Sentence(f"Left out, because a footnote of this run concerns them: {', '.join(named)}.")
