"""The suite's own table: means, paired differences, published values, and seconds of training."""

from collections.abc import Sequence
from dataclasses import replace

from ..analysis.findings import suite_sentences
from ..summary import CellSummary, ColumnSummary, RowSummary, Summary, protocol_title
from ..wording import mean_over, number
from .caption import preset_and_recipe, unfinished
from .doubts import footnotes, marks, remarks, shown_verdict
from .legend import legend
from .model import Cell, Column, Row, Table, difference_of, missing_cell, rank_in_words

TRAINING = Column("Training", "s", "down", 1, key="seconds")
"""Mean seconds of training a cell."""


def suite_table(summary: Summary) -> Table:
    """The table of a run's suite, with the seconds of training in the last column."""
    columns = [*metric_columns(summary["columns"]), TRAINING]
    rows = [_row(summary, row) for row in summary["rows"]]
    made = Table(
        summary["suite"],
        summary["title"],
        columns,
        rows,
        caption=_caption(summary),
        source=f"made by radiogs-bench from the results {', '.join(summary['keys'])}",
        reference=next((row for row in rows if row.key == summary["reference"]), None),
        published_data=summary["published_data"],
        footnotes=footnotes(summary),
        remarks=remarks(summary),
        findings=suite_sentences(summary),
    )
    return replace(
        made,
        notes=made.reasons,
        legend=legend(made, summary["scenes"], coloured=True),
        legend_in_words=legend(made, summary["scenes"], coloured=False),
    )


def metric_columns(columns: Sequence[ColumnSummary]) -> list[Column]:
    """The columns of metrics."""
    return [
        Column(
            each["label"],
            each["unit"],
            each["direction"],
            each["decimals"],
            key=each["key"],
            published_by=each.get("published_by", ""),
            smallest=each.get("smallest"),
            meaning=each.get("meaning", ""),
        )
        for each in columns
    ]


def _row(summary: Summary, row: RowSummary) -> Row:
    cells = [_cell(summary, row["key"], column) for column in summary["columns"]]
    return Row(row["text"], [*cells, training_cell(row["seconds"])], row["key"], row["latex"])


def _cell(summary: Summary, row: str, column: ColumnSummary) -> Cell:
    stored: CellSummary = summary["cells"][row][column["key"]]
    decimals, difference = column["decimals"], stored["difference"]
    published = summary["published"].get(row, {}).get(column["key"])
    printed = None if published is None else Cell(number(published, decimals), published)
    is_beside = "published_by" not in column
    value = value_cell(stored["mean"], column, stored["reason"])
    return replace(
        value,
        marks="" if value.value is None else marks(summary, row, column["key"]),
        rank=rank_in_words(stored.get("rank")),
        difference=difference_of(difference, decimals, shown_verdict(summary, row, column["key"], difference)),
        published=printed if is_beside else None,
    )


def value_cell(value: float | None, column: ColumnSummary, reason: str | None) -> Cell:
    """A value of a metric; where zero is best, it sorts by its magnitude."""
    if value is None:
        return missing_cell(reason)
    return Cell(number(value, column["decimals"]), abs(value) if column["direction"] == "zero" else value)


def training_cell(seconds: float | None, reason: str = "no finished cell of the row trained anything") -> Cell:
    """Seconds of training."""
    return missing_cell(reason) if seconds is None else Cell(number(seconds, TRAINING.decimals), seconds)


def _caption(summary: Summary) -> str:
    return (
        f"{summary['title']}. Mean over {mean_over(summary)}; {preset_and_recipe(summary)}; metric protocol"
        f" {protocol_title(summary)}.{unfinished(summary)}"
    )
