"""Records of longer runs, which are committed with the project, and whether this run agrees with them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from ..analysis.findings import Finding, measured, record_findings, record_sentences
from ..analysis.grid import Grid, Item, name_item
from ..summary import ColumnSummary, LongerRun, RecordedGrid, Summary
from ..wording import heading, mean_over, number, signed
from .caption import ORIGIN
from .doubts import shown_verdict
from .legend import legend
from .model import Cell, Difference, Row, Table, difference_of, rank_in_words, stored_ranks
from .suite import TRAINING, metric_columns, training_cell, value_cell

HEADING = "Record of a longer run, committed with the project (not measured here)"

OUTCOMES = SAME, OPPOSITE, OPEN, HERE_ALONE, NEITHER = (
    "the same sign here as in the record, both resolved",
    "the opposite sign here, both resolved",
    "not resolved here, but in the record",
    "resolved here, but not in the record",
    "resolved neither here nor in the record",
)


class Agreement(NamedTuple):
    """Whether the difference of a row in a column to the reference row agrees with the recorded one."""

    row: str
    """Its label."""
    column: str
    """Its label."""
    outcome: str
    """One of OUTCOMES."""
    sentence: str


class LongerReport(NamedTuple):
    """A longer run as the reports show it."""

    title: str
    facts: Mapping[str, str]
    """Its origin and its conditions, by heading."""
    table: Table
    agreements: Sequence[Agreement]
    """Row by row; empty where no run stands beside it."""
    by_scene: Grid
    """Its differences to the reference row, scene by scene."""

    @property
    def rows_in_words(self) -> list[str]:
        """The agreements in one sentence for each row: the columns of every outcome."""
        found: dict[str, dict[str, list[str]]] = {}
        for each in self.agreements:
            found.setdefault(each.row, {}).setdefault(each.outcome, []).append(each.column)
        return [
            f"{row}: {'; '.join(_listed(outcome, of) for outcome in OUTCOMES if outcome in of)}."
            for row, of in found.items()
        ]


def _listed(outcome: str, columns: Mapping[str, Sequence[str]]) -> str:
    return f"{outcome}: {', '.join(columns[outcome])}"


def longer_reports(summary: Summary) -> list[LongerReport]:
    """The record of the suite's longer runs, each compared with this run; empty where the project has none."""
    return [
        longer_report(run, f"record-{number}", list(agreements(summary, run)))
        for number, run in enumerate(summary.get("longer_runs", []))
    ]


def longer_report(run: LongerRun, name: str, compared: Sequence[Agreement] = ()) -> LongerReport:
    """A longer run as it is shown. ``name``: of its table. ``compared``: its agreements with another run."""
    return LongerReport(run["title"], facts(run), recorded_table(run, name), compared, by_scene(run, f"{name}-scenes"))


def facts(run: LongerRun) -> dict[str, str]:
    """Origin and conditions of a longer run, by heading; without those that are not known."""
    found = {
        **{name: run["origin"].get(name, "") for name in ORIGIN},
        "Machine": run["machine"],
        "Recipe": run["recipe"],
        "Preset": run["preset"],
        "Metric protocol": run["protocol"],
        "Scenes": ", ".join(run["scenes"]),
        "Seeds": ", ".join(map(str, run["seeds"])),
        "Mean over": mean_over(run, named=False),
    }
    return {name: text for name, text in found.items() if text}


def recorded_table(run: LongerRun, name: str) -> Table:
    """Means and differences of a longer run, with the seconds of training in the last column."""
    rows = [
        Row(
            row["text"],
            [*(_cell(run, row["key"], column) for column in run["columns"]), training_cell(row["seconds"])],
            row["key"],
            row["latex"],
        )
        for row in run["rows"]
    ]
    made = Table(
        name,
        run["title"],
        [*metric_columns(run["columns"]), TRAINING],
        rows,
        caption=f"{HEADING}: {run['title']}. Mean over {mean_over(run, named=False)}; preset {run['preset']}.",
        reference=next((row for row in rows if row.key == run["reference"]), None),
        findings=record_sentences(run),
    )
    return replace(
        made,
        notes=made.reasons,
        legend=legend(made, run["scenes"], coloured=True),
        legend_in_words=legend(made, run["scenes"], coloured=False),
    )


def _cell(run: LongerRun, row: str, column: ColumnSummary) -> Cell:
    stored = run["cells"][row][column["key"]]
    return replace(
        value_cell(stored["mean"], column, stored["reason"]),
        rank=rank_in_words(stored_ranks(run["cells"], column["key"], column["direction"]).get(row)),
        difference=_recorded(run, row, column),
    )


def _recorded(run: LongerRun, row: str, column: ColumnSummary) -> Difference | None:
    interval = run["cells"][row][column["key"]]["difference"]
    return difference_of(interval, column["decimals"], None if interval is None else interval["verdict"])


def claims(runs: Sequence[LongerRun]) -> Grid | None:
    """The paper's differences, each beside what the recorded runs of its suite measured by every recipe; None where
    the paper reports none of their differences."""
    recipes = list(dict.fromkeys(run["recipe"] for run in runs))
    found: dict[tuple[str, str, str], dict[str, Finding]] = {}
    columns: dict[tuple[str, str, str], tuple[str, ColumnSummary]] = {}
    for run in runs:
        texts, own = {row["key"]: row["text"] for row in run["rows"]}, {each["key"]: each for each in run["columns"]}
        for each in record_findings(run):
            if each.published is not None:
                claim = run["suite"], each.row, each.column
                found.setdefault(claim, {})[run["recipe"]] = each
                columns[claim] = texts[each.row], own[each.column]
    if not found:
        return None
    rows = []
    for claim, by_recipe in found.items():
        text, column = columns[claim]
        published = next(iter(by_recipe.values())).published
        assert published is not None  # only such findings are kept
        line = [name_item(claim[0]), name_item(text), name_item(heading(column))]
        line.append(Item(signed(published, column["decimals"]), published))
        rows.append([*line, *(_claimed(by_recipe.get(recipe), column) for recipe in recipes)])
    note = (
        "Differences to the reference row: the paper's, and those measured by each recipe with 95 % intervals. Its sign"
        " holds, or does not, where a difference is resolved. *Could show* is the smallest true difference that four of"
        " five such runs resolve; the paper's size is excluded where it lies outside the interval and is not too small."
    )
    heads = ["suite", "row", "metric", "paper", *(recipe or "default" for recipe in recipes)]
    return Grid("claims", "The paper's claims", note, heads, rows)


def _claimed(found: Finding | None, column: ColumnSummary) -> Item:
    if found is None:
        return Item("n/a", None, "no recorded run by this recipe")
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


def grid_of(stored: RecordedGrid) -> Grid:
    """A recorded table of derived values."""
    lines = [[name_item(text) for text in line] for line in stored["lines"]]
    return Grid("recorded", stored["title"], stored["note"], stored["heads"], lines)


def by_scene(run: LongerRun, name: str) -> Grid:
    """The differences of a longer run to its reference row: a line for each row and column, a column for each scene."""
    rows = [
        [
            name_item(row["text"]),
            name_item(heading(column)),
            *(
                Item("n/a", None, "no seed has both")
                if value is None
                else Item(signed(value, column["decimals"]), value)
                for value in run["cells"][row["key"]][column["key"]]["by_scene"]
            ),
        ]
        for row in run["rows"]
        for column in run["columns"]
        if run["cells"][row["key"]][column["key"]]["by_scene"]
    ]
    note = "Difference to the reference row on each scene, the mean over its seeds."
    return Grid(name, "Differences scene by scene", note, ["row", "metric", *run["scenes"]], rows)


def agreements(summary: Summary, run: LongerRun) -> Iterator[Agreement]:
    """Whether each difference of this run agrees with that of the record, where both have one."""
    texts = {row["key"]: row["text"] for row in run["rows"]}
    columns = {column["key"]: column for column in run["columns"]}
    for row in (each["key"] for each in summary["rows"] if each["key"] in texts):
        for column in (each for each in summary["columns"] if each["key"] in columns):
            interval = summary["cells"][row][column["key"]]["difference"]
            verdict = shown_verdict(summary, row, column["key"], interval)
            here = difference_of(interval, column["decimals"], verdict)
            there = _recorded(run, row, columns[column["key"]])
            if here is not None and there is not None:
                outcome = _outcome(here, there)
                unit = f" {column['unit']}".rstrip()
                sentence = (
                    f"{texts[row]}, {column['label']}: {outcome}. Here {_in_words(here, unit)}, in the record"
                    f" {_in_words(there, unit)}."
                )
                yield Agreement(texts[row], column["label"], outcome, sentence)


def _outcome(here: Difference, there: Difference) -> str:
    if here.verdict and there.verdict:
        return SAME if here.verdict == there.verdict else OPPOSITE
    if there.verdict:
        return OPEN
    return HERE_ALONE if here.verdict else NEITHER


def _in_words(difference: Difference, unit: str) -> str:
    return f"{difference.plus_minus}{unit}" + (f" ({difference.verdict})" if difference.verdict else "")
