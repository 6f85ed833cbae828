"""The suite's own table: means, paired differences, published values, and seconds of training."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from ..analysis.findings import compared_run, headline, sentences_of
from ..summary import CellSummary, ColumnSummary, RecordedRun, Summary, counted_scenes, protocol_title
from ..wording import mean_over, number
from .caption import preset_and_recipe, unfinished
from .doubts import footnotes, marks, remarks, shown_verdict
from .legend import with_legend
from .model import Column, PrintedCell, PrintedRow, Table, difference_of, missing_cell, rank_in_words

TRAINING = Column("Training", "s", "down", 1, key="seconds")
"""Mean seconds of training a cell."""


def suite_table(summary: Summary) -> Table:
    """The table of a run's suite, with the seconds of training in the last column."""
    made = run_table(summary, summary["suite"], partial(_cell, summary), _caption(summary))
    return replace(
        made,
        source=f"made by radiogs-bench from the results {', '.join(summary['keys'])}",
        published_data=summary["published_data"],
        footnotes=footnotes(summary),
        remarks=remarks(summary),
    )


def run_table(
    run: Summary | RecordedRun,
    name: str,
    cell_of: Callable[[str, ColumnSummary], PrintedCell],
    caption: str,
) -> Table:
    """The table of a run's metrics with the seconds of training in the last column, its findings and its legend."""
    rows = [
        PrintedRow(
            row["text"],
            [*(cell_of(row["key"], column) for column in run["columns"]), training_cell(row["seconds"])],
            row["key"],
            row["latex"],
        )
        for row in run["rows"]
    ]
    made = Table(
        name,
        run["title"],
        [*(Column(**each) for each in run["columns"]), TRAINING],
        rows,
        caption=caption,
        reference=next((row for row in rows if row.key == run["reference"]), None),
        headline=headline(compared_run(run)),
        findings=sentences_of(compared_run(run)),
    )
    return with_legend(replace(made, notes=made.reasons), counted_scenes(run))


def _cell(summary: Summary, row: str, column: ColumnSummary) -> PrintedCell:
    stored: CellSummary = summary["cells"][row][column["key"]]
    decimals, difference = column["decimals"], stored["difference"]
    published = summary["published"].get(row, {}).get(column["key"])
    printed = None if published is None else PrintedCell(number(published, decimals), published)
    is_beside = "published_by" not in column
    return replace(
        value_cell(stored["mean"], column, stored["reason"]),
        marks="" if stored["mean"] is None else marks(summary, row, column["key"]),
        rank=rank_in_words(stored.get("rank")),
        difference=difference_of(difference, decimals, shown_verdict(summary, row, column["key"], difference)),
        published=printed if is_beside else None,
    )


def value_cell(value: float | None, column: ColumnSummary, reason: str | None) -> PrintedCell:
    """A value of a metric; if zero is best, it sorts by its magnitude."""
    if value is None:
        return missing_cell(reason)
    return PrintedCell(number(value, column["decimals"]), abs(value) if column["direction"] == "zero" else value)


def training_cell(seconds: float | None, reason: str = "no finished cell of the row trained anything") -> PrintedCell:
    """Seconds of training."""
    return missing_cell(reason) if seconds is None else PrintedCell(number(seconds, TRAINING.decimals), seconds)


def _caption(summary: Summary) -> str:
    return (
        f"{summary['title']}. Mean over {mean_over(summary)}; {preset_and_recipe(summary)}; metric protocol"
        f" {protocol_title(summary)}.{unfinished(summary)}"
    )
