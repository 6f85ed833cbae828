"""Records, which are committed with the project, and whether a run agrees with the record of its suite."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

from ..analysis.findings import MeasuredDifference, compared_run, differences_of, measured
from ..analysis.report import Grid, Item, name_item
from ..summary import ColumnSummary, RecordedRun, Summary
from ..wording import count_of, heading, marked, mean_over, number, signed
from .caption import ORIGIN
from .model import Difference, PrintedCell, Table, difference_of, rank_in_words, stored_ranks
from .suite import run_table, suite_table, value_cell

HEADING = "Record of a longer run, committed with the project (not measured here)"

SAME, OPPOSITE, OPEN, HERE_ALONE, NEITHER = (
    "the same sign here as in the record, both resolved",
    "the opposite sign here, both resolved",
    "not resolved here, but in the record",
    "resolved here, but not in the record",
    "resolved neither here nor in the record",
)


class Agreement(NamedTuple):
    """Whether the difference of a row in a column, by their labels, to the reference row agrees with the recorded
    one."""

    row: str
    column: str
    outcome: str
    """The outcome: one of the five constants above."""
    sentence: str


class RecordReport(NamedTuple):
    """A recorded run as the reports show it."""

    title: str
    facts: Mapping[str, str]
    """Its origin and conditions by heading, without unknown ones."""
    table: Table
    agreements: Sequence[Agreement]
    """Row by row; empty without a run to compare with."""
    by_scene: Grid
    """Its differences to the reference row, scene by scene."""

    @property
    def agreement(self) -> str:
        """The number of differences that agree with this run, in a sentence; empty without a run to compare with."""
        counts = Counter(each.outcome for each in self.agreements)
        if not counts:
            return ""
        date, scenes = self.facts.get("Date", "a longer run"), count_of(len(self.by_scene.heads) - 2, "scene")
        return (
            f"Record of {date} ({scenes}): {counts[SAME]} of {count_of(counts.total(), 'difference')} resolved in both"
            f" with equal signs, {counts[OPPOSITE]} with opposite ones, {counts[OPEN] + counts[HERE_ALONE]} in one."
        )


def record_reports(summary: Summary) -> list[RecordReport]:
    """The record of a run's suite, each of its runs compared with this run; empty if the project has none."""
    here = suite_table(summary)
    return [record_report(run, f"record-{place}", here) for place, run in enumerate(summary.get("longer_runs", []))]


def record_report(run: RecordedRun, name: str, here: Table | None = None) -> RecordReport:
    """A recorded run for display. ``name``: of its table. ``here``: the table of a run to compare with it."""
    facts = {
        **{name: run["origin"].get(name, "") for name in ORIGIN},
        "Machine": run["machine"],
        "Recipe": run["recipe"],
        "Preset": run["preset"],
        "Metric protocol": run["protocol"],
        "Scenes": ", ".join(marked(run, each) for each in run["scenes"]),
        "Seeds": ", ".join(map(str, run["seeds"])),
        "Mean over": mean_over(run, named=False),
    }
    known, table = {name: text for name, text in facts.items() if text}, recorded_table(run, name)
    compared = [] if here is None else list(agreements(here, table))
    return RecordReport(run["title"], known, table, compared, by_scene(run, f"{name}-scenes"))


def recorded_table(run: RecordedRun, name: str) -> Table:
    """Means and differences of a recorded run."""
    caption = f"{HEADING}: {run['title']}. Mean over {mean_over(run, named=False)}; preset {run['preset']}."
    return run_table(run, name, partial(_cell, run), caption)


def _cell(run: RecordedRun, row: str, column: ColumnSummary) -> PrintedCell:
    stored = run["cells"][row][column["key"]]
    interval = stored["difference"]
    return replace(
        value_cell(stored["mean"], column, stored["reason"]),
        rank=rank_in_words(stored_ranks(run["cells"], column["key"], column["direction"]).get(row)),
        difference=difference_of(interval, column["decimals"], None if interval is None else interval["verdict"]),
    )


def claims(runs: Sequence[RecordedRun]) -> Grid | None:
    """The paper's differences, each beside the measured differences of its suite's recorded runs by every recipe; None
    if the paper reports none of these differences."""
    recipes = list(dict.fromkeys(run["recipe"] for run in runs))
    lines: dict[tuple[str, str, str], list[Item]] = {}
    for run in runs:
        texts = {row["key"]: row["text"] for row in run["rows"]}
        columns = {column["key"]: column for column in run["columns"]}
        for found in differences_of(compared_run(run)):
            if found.published is not None:
                column = columns[found.column]
                paper = Item(signed(found.published, column["decimals"]), found.published)
                names = [name_item(each) for each in (run["suite"], texts[found.row], heading(column))]
                absent = [Item("n/a", None, "no recorded run by this recipe")] * len(recipes)
                line = lines.setdefault((run["suite"], found.row, found.column), [*names, paper, *absent])
                line[4 + recipes.index(run["recipe"])] = _claimed(found, column)
    if not lines:
        return None
    note = (
        "Differences to the reference row: the paper's, and those measured by each recipe with 95 % intervals. Its sign"
        " holds, or does not, where a difference is resolved. *Could show* is the smallest true difference that four of"
        " five such runs resolve; the paper's size is excluded where it lies outside the interval and is not too small."
    )
    heads = ["suite", "row", "metric", "paper", *(recipe or "default" for recipe in recipes)]
    return Grid("claims", "The paper's claims", note, heads, list(lines.values()))


def _claimed(found: MeasuredDifference, column: ColumnSummary) -> Item:
    if found.doubted:
        remarks = ["in doubt"]
    elif found.resolved:
        remarks = [f"sign {found.verdict}" if found.verdict is not None else "resolved"]
    else:
        size = "" if found.smallest is None else f", could show {number(found.smallest, column['decimals'])}"
        remarks = [f"not resolved{size}"]
    if found.excluded:
        remarks.append("the paper's size excluded")
    return Item(f"{measured(column, found.difference).strip()}: {'; '.join(remarks)}", found.difference["mean"])


def by_scene(run: RecordedRun, name: str) -> Grid:
    """The differences of a recorded run to its reference row: a line for each row and metric, a column a scene."""
    rows = []
    for row in run["rows"]:
        for column in run["columns"]:
            values = run["cells"][row["key"]][column["key"]]["by_scene"]
            items = [
                Item("n/a", None, "no seed has both")
                if value is None
                else Item(signed(value, column["decimals"]), value)
                for value in values
            ]
            if items:
                rows.append([name_item(row["text"]), name_item(heading(column)), *items])
    note = "Difference to the reference row on each scene, the mean over its seeds."
    heads = ["row", "metric", *(marked(run, each) for each in run["scenes"])]
    return Grid(name, "Differences scene by scene", note, heads, rows)


def agreements(here: Table, recorded: Table) -> Iterator[Agreement]:
    """Whether each difference of a run agrees with the recorded one, where both have one."""
    labels = {row.key: row.text for row in recorded.rows}
    known = recorded.differences
    for (row, column), mine in here.differences.items():
        if (theirs := known.get((row, column))) is not None:
            (found,) = (each for each in here.columns if each.key == column)
            outcome, both = _outcome(mine, theirs), [_in_words(each, found.unit) for each in (mine, theirs)]
            sentence = f"{labels[row]}, {found.label}: {outcome}. Here {both[0]}, in the record {both[1]}."
            yield Agreement(labels[row], found.label, outcome, sentence)


def _outcome(here: Difference, there: Difference) -> str:
    if here.verdict and there.verdict:
        return SAME if here.verdict == there.verdict else OPPOSITE
    if there.verdict:
        return OPEN
    return HERE_ALONE if here.verdict else NEITHER


def _in_words(difference: Difference, unit: str) -> str:
    verdict = f" ({difference.verdict})" if difference.verdict else ""
    return f"{difference.plus_minus} {unit}".rstrip() + verdict
