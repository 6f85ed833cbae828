"""Tables of the page as plain values; the template renders them, the script sorts them."""

from collections.abc import Sequence
from dataclasses import dataclass

from ..analysis.grid import Grid
from ..analysis.legend import paper_legend, shown_verdict, suite_legend, verdict_of, without_marked
from ..analysis.samples import cost_of
from ..doubts import footnotes, marks, remarks
from ..summary import (
    CellSummary,
    ColumnSummary,
    PaperColumn,
    PaperTable,
    RowSummary,
    RunSummary,
    Summary,
    Verdict,
    beside,
    half_width,
    row_texts,
)
from ..wording import ARROWS, plus_minus, signed
from ..write.paper_layout import as_printed
from ..write.paper_reading import apart, change, is_beside, measured, row_label


@dataclass(frozen=True)
class Head:
    """A column's heading; ``numeric`` columns sort by number and are aligned right."""

    label: str
    unit: str = ""
    arrow: str = ""
    numeric: bool = True


@dataclass(frozen=True)
class Entry:
    """An entry of a table: its text and the value that it sorts by, with the difference and published value below it.

    ``verdict``: what it is coloured by. ``rank``: its rank among the rows, in words. ``opens``: key of the cell whose
    provenance the entry opens. ``row``: key of the row that it names.
    """

    text: str
    value: float | str | None
    difference: str = ""
    difference_value: float | None = None
    published: str = ""
    published_value: float | None = None
    reason: str = ""
    verdict: Verdict | None = None
    rank: str = ""
    opens: str = ""
    row: str = ""


@dataclass(frozen=True)
class Table:
    """A table: rows of entries under ``heads``, the row's name first. ``title``: shown while the table is folded.

    ``legend``: how the table is read. ``footnotes``: below the table, each behind the mark that entries have.
    ``remarks``: of whole rows, folded.
    """

    name: str
    caption: str
    heads: list[Head]
    rows: list[list[Entry]]
    title: str = ""
    legend: Sequence[str] = ()
    footnotes: Sequence[str] = ()
    remarks: Sequence[str] = ()

    @property
    def reasons(self) -> list[str]:
        """Why entries are n/a, each reason once: printed, because tooltips need a mouse."""
        return list(
            dict.fromkeys(entry.reason.rstrip(".") for row in self.rows for entry in row if entry.value is None)
        )

    @property
    def differs(self) -> bool:
        """Whether entries have differences, by which the table can be sorted too."""
        return any(entry.difference for row in self.rows for entry in row)

    @property
    def published(self) -> bool:
        """Whether entries have published values, by which the table can be sorted too."""
        return any(entry.published for row in self.rows for entry in row)


def heads_of(columns: Sequence[ColumnSummary]) -> list[Head]:
    """Headings of metrics."""
    return [Head(column["label"], column["unit"], ARROWS[column["direction"]]) for column in columns]


def suite_table(summary: Summary) -> Table:
    """The suite's own table: means, differences with intervals, published values, and training seconds."""
    rows = []
    for row in summary["rows"]:
        values = [
            value_entry(
                summary["cells"][row["key"]][column["key"]],
                column,
                beside(summary, row["key"], column),
                shown_verdict(
                    summary, row["key"], column["key"], summary["cells"][row["key"]][column["key"]]["difference"]
                ),
                marks(summary, row["key"], column["key"]),
            )
            for column in summary["columns"]
        ]
        rows.append([Entry(row["text"], row["text"], row=row["key"]), *values, seconds_entry(row)])
    heads = [Head("row", numeric=False), *heads_of(summary["columns"]), Head("training", "s", ARROWS["down"])]
    return Table(
        "means", summary["title"], heads, rows, "", suite_legend(summary), footnotes(summary), remarks(summary)
    )


def value_entry(
    cell: CellSummary, column: ColumnSummary, published: float | None, verdict: Verdict | None, mark: str = ""
) -> Entry:
    """A value with the marks of its footnotes, its difference to the reference row and the published value."""
    decimals = column["decimals"]
    interval = cell["difference"]
    difference = ""
    if interval is not None:
        difference = plus_minus(signed(interval["mean"], decimals), half_width(interval), decimals)
    return Entry(
        text="n/a" if cell["mean"] is None else f"{cell['mean']:.{decimals}f}{mark}",
        value=sort_value(cell["mean"], column),
        difference=difference,
        difference_value=None if interval is None else interval["mean"],
        published="" if published is None else f"{published:.{decimals}f}",
        published_value=published,
        reason=cell["reason"] or "",
        verdict=verdict,
        rank=rank_in_words(cell.get("rank")),
    )


def rank_in_words(rank: int | None) -> str:
    """How many rows are resolved to be better; empty for a row that was not compared."""
    return "" if rank is None else f"{rank - 1 or 'no'} row{'' if rank == 2 else 's'} resolved to be better"


def sort_value(value: float | None, column: ColumnSummary) -> float | None:
    """What a value sorts by: itself, or its magnitude where zero is the best."""
    return abs(value) if value is not None and column["direction"] == "zero" else value


def seconds_entry(row: RowSummary) -> Entry:
    """Mean training seconds per cell of the row."""
    if row["seconds"] is None:
        return Entry("n/a", None, reason="no finished cell of the row trained anything")
    return Entry(f"{row['seconds']:.1f}", row["seconds"])


def paper_tables(table: PaperTable, summary: Summary) -> list[Table]:
    """A table of the paper; missing values have their reason.

    Published values stand below the measured ones, or in a second table if they are by other conventions.
    """
    title, sentences = apart(table, summary), paper_legend(table, summary)
    table = as_printed(without_marked(table, summary))
    return [measured_table(table, sentences), *([published_table(table, title)] if title else [])]


def measured_table(table: PaperTable, sentences: Sequence[str]) -> Table:
    """The measured values, with published ones below them where those are by the same conventions."""
    rows = []
    for row in table["rows"]:
        entries = [Entry(row_label(row), row_label(row), reason=row["remark"])]
        for column in table["columns"]:
            value = table["cells"][row["key"]][column["key"]]
            printed = value["published"] if is_beside(column) else None
            entries.append(
                Entry(
                    text=measured(value, column) or "n/a",
                    value=value["mean"],
                    difference=change(value, column, " ± "),
                    difference_value=value["difference"]["mean"] if value["difference"] else None,
                    published=printed or "",
                    published_value=float(printed) if printed else None,
                    reason=value["reason"] or "",
                    verdict=verdict_of(value),
                    rank=rank_in_words(value.get("rank")),
                )
            )
        rows.append(entries)
    return Table(
        f"paper-{table['key']}",
        f"Published: {table['data']}.",
        paper_heads(table["columns"]),
        rows,
        table["title"],
        sentences,
    )


def published_table(table: PaperTable, title: str) -> Table:
    """Published values by other conventions than the measured ones."""
    columns = [column for column in table["columns"] if not is_beside(column)]
    rows = []
    for row in table["rows"]:
        entries = [Entry(row["text"], row["text"], reason=row["remark"])]
        for column in columns:
            value = table["cells"][row["key"]][column["key"]]
            number = None if value["published"] is None else float(value["published"])
            entries.append(Entry(value["published"] or "n/a", number, reason=value["absent"] or ""))
        rows.append(entries)
    return Table(f"published-{table['key']}", f"{title}: {table['data']}.", paper_heads(columns), rows,
                 f"{table['title']}: published values")  # fmt: skip


def paper_heads(columns: Sequence[PaperColumn]) -> list[Head]:
    """Headings of a table of the paper, the row's name first."""
    heads = [Head(f"{each['group']} {each['label']}".strip(), each["unit"], ARROWS[each["direction"]])
             for each in columns]  # fmt: skip
    return [Head("row", numeric=False), *heads]


def grid_table(grid: Grid) -> Table:
    """A grid of derived values; a column sorts by number if all of its known values are numbers."""
    rows = [[Entry(item.text, item.value, reason=item.reason) for item in row] for row in grid.rows]
    kinds = [{type(row[place].value) for row in rows} - {type(None)} for place in range(len(grid.heads))]
    heads = [Head(text, numeric=str not in kind) for text, kind in zip(grid.heads, kinds, strict=True)]
    return Table(f"grid-{grid.name}", grid.note, heads, rows, grid.title)


def cells_table(summary: Summary) -> Table:
    """Every cell with its metric values; its name opens its provenance."""
    texts = row_texts(summary)
    heads = [
        Head("row", numeric=False),
        Head("scene", numeric=False),
        Head("seed"),
        *heads_of(summary["columns"]),
        Head("training", "s", ARROWS["down"]),
        Head("surfels"),
        Head("state", numeric=False),
    ]
    rows = [
        [
            Entry(texts[run["row"]], texts[run["row"]], opens=run["key"]),
            Entry(run["scene"], run["scene"]),
            Entry(str(run["seed"]), run["seed"]),
            *(metric_entry(run, column) for column in summary["columns"]),
            training_entry(run),
            surfels_entry(run),
            Entry(run["state"], run["state"]),
        ]
        for run in summary["runs"]
    ]
    return Table("cells", "Every cell of the run", heads, rows)


def metric_entry(run: RunSummary, column: ColumnSummary) -> Entry:
    """A cell's own value of a metric."""
    value = run["metrics"].get(column["key"])
    if value is None:
        return Entry("n/a", None, reason=run["state"] if not run["metrics"] else "the cell has no such value")
    return Entry(f"{value:.{column['decimals']}f}", sort_value(value, column))


def training_entry(run: RunSummary) -> Entry:
    """A cell's training seconds."""
    spent = cost_of(run, "seconds")
    if spent is None:
        return Entry("n/a", None, reason=why_not(run, "nothing was trained"))
    return Entry(f"{spent:.1f}", spent)


def surfels_entry(run: RunSummary) -> Entry:
    """Number of surfels of a cell's model."""
    if run["surfels"] is None:
        return Entry("n/a", None, reason=why_not(run, "the result holds no number of surfels"))
    return Entry(str(run["surfels"]), run["surfels"])


def why_not(run: RunSummary, reason: str) -> str:
    """Why a cell has no value: the reason if it is finished, otherwise its state."""
    return reason if run["state"] == "finished" else run["state"]
