"""Tables of the page as plain values; the template turns them into markup and the script sorts them."""

from collections.abc import Sequence
from dataclasses import dataclass

from ..analysis.pareto import cost_of
from ..analysis.ranks import ranks
from ..summary import CellSummary, ColumnSummary, PaperTable, RowSummary, RunSummary, Summary
from ..write.grid import Grid
from ..write.paper.layout import as_printed
from ..write.paper.reading import change, measured
from ..write.paper.reading import ranks as paper_ranks
from ..write.plain import ARROWS, signed_figure


@dataclass(frozen=True)
class Head:
    """A column's heading; ``numeric`` columns sort by number and are set flush right."""

    label: str
    unit: str = ""
    arrow: str = ""
    numeric: bool = True


@dataclass(frozen=True)
class Entry:
    """What stands in a cell of a table: the text and the number it sorts by, and what stands below it.

    ``opens`` is the key of a cell whose provenance the entry opens.
    """

    text: str
    value: float | str | None
    difference: str = ""
    difference_value: float | None = None
    published: str = ""
    published_value: float | None = None
    reason: str = ""
    rank: int = 0
    opens: str = ""


@dataclass(frozen=True)
class Table:
    """A table: ``rows`` are entries under ``heads``, the first of them the row's name.

    ``title`` is what it is called where it is folded away; its ``caption`` then says the rest.
    """

    name: str
    caption: str
    heads: list[Head]
    rows: list[list[Entry]]
    title: str = ""

    @property
    def reasons(self) -> list[str]:
        """Why entries are n/a, each reason once: a hint at the mouse alone would be out of many people's reach."""
        return list(
            dict.fromkeys(entry.reason.rstrip(".") for row in self.rows for entry in row if entry.value is None)
        )

    @property
    def compared(self) -> bool:
        """Whether there is a published figure or a difference, by which it can be sorted too."""
        return any(entry.difference or entry.published for row in self.rows for entry in row)


def heads_of(columns: Sequence[ColumnSummary]) -> list[Head]:
    """The headings of figures."""
    return [Head(column["label"], column["unit"], ARROWS[column["direction"]]) for column in columns]


def suite_table(summary: Summary) -> Table:
    """The suite's own table: means, differences with intervals, published figures, and what a cell costs."""
    placed = {column["key"]: ranks(summary, column) for column in summary["columns"]}
    rows = []
    for row in summary["rows"]:
        published = summary["published"].get(row["key"], {})
        figures = [
            figure(
                summary["cells"][row["key"]][column["key"]],
                column,
                published.get(column["key"]),
                placed[column["key"]].get(row["key"], 0),
            )
            for column in summary["columns"]
        ]
        rows.append([Entry(row["text"], row["text"]), *figures, seconds_of(row)])
    heads = [Head("row", numeric=False), *heads_of(summary["columns"]), Head("training", "s", ARROWS["down"])]
    return Table("means", summary["title"], heads, rows)


def figure(cell: CellSummary, column: ColumnSummary, published: float | None, rank: int) -> Entry:
    """One figure with its difference to the reference row and the published one."""
    digits = column["decimals"]
    interval = cell["difference"]
    difference = ""
    if interval is not None:
        difference = signed_figure(interval["mean"], digits)
        if interval["low"] is not None and interval["high"] is not None:
            difference += f" ± {(interval['high'] - interval['low']) / 2:.{digits}f}"
    return Entry(
        text="n/a" if cell["mean"] is None else f"{cell['mean']:.{digits}f}",
        value=sorted_by(cell["mean"], column),
        difference=difference,
        difference_value=None if interval is None else interval["mean"],
        published="" if published is None else f"{published:.{digits}f}",
        published_value=published,
        reason=cell["reason"] or "",
        rank=rank if rank <= 3 else 0,
    )


def sorted_by(value: float | None, column: ColumnSummary) -> float | None:
    """What a figure sorts by: itself, or how far it is from zero where zero is the best."""
    return abs(value) if value is not None and column["direction"] == "zero" else value


def seconds_of(row: RowSummary) -> Entry:
    """Mean seconds of training a cell of the row."""
    if row["seconds"] is None:
        return Entry("n/a", None, reason="no finished cell of the row trained anything")
    return Entry(f"{row['seconds']:.1f}", row["seconds"])


def paper_table(table: PaperTable) -> Table:
    """A table of the paper, measured beside published; what has no measured figure is there with its reason."""
    table = as_printed(table)
    rows = []
    for row in table["rows"]:
        entries = [Entry(row["text"], row["text"], reason=row["remark"])]
        for column in table["columns"]:
            cell = table["cells"][row["key"]][column["key"]]
            entries.append(
                Entry(
                    text=measured(cell, column) or "n/a",
                    value=cell["mean"],
                    difference=change(cell, column, " ± "),
                    difference_value=cell["difference"]["mean"] if cell["difference"] else None,
                    published=cell["published"] or "",
                    published_value=float(cell["published"]) if cell["published"] else None,
                    reason=cell["reason"] or "",
                    rank=paper_ranks(table, column, of_published=False).get(row["key"], 0),
                )
            )
        rows.append(entries)
    arrows = {**ARROWS, "none": ""}
    heads = [Head(f"{each['group']} {each['label']}".strip(), each["unit"], arrows[each["direction"]])
             for each in table["columns"]]  # fmt: skip
    return Table(
        f"paper-{table['key']}",
        f"Published: {table['data']}.",
        [Head("row", numeric=False), *heads],
        rows,
        table["title"],
    )


def grid_table(grid: Grid) -> Table:
    """A grid of derived figures; a column sorts by number if all that is known of it are numbers."""
    rows = [[Entry(item.text, item.value, reason=item.reason) for item in row] for row in grid.rows]
    kinds = [{type(row[place].value) for row in rows} - {type(None)} for place in range(len(grid.heads))]
    heads = [Head(text, numeric=str not in kind) for text, kind in zip(grid.heads, kinds, strict=True)]
    return Table(f"grid-{grid.name}", grid.note, heads, rows, grid.title)


def cells_table(summary: Summary) -> Table:
    """Every cell with its figures; its name opens its provenance."""
    texts = {row["key"]: row["text"] for row in summary["rows"]}
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
            *(plain_figure(run, column) for column in summary["columns"]),
            training(run),
            count(run),
            Entry(run["state"], run["state"]),
        ]
        for run in summary["runs"]
    ]
    return Table("cells", "Every cell of the run", heads, rows)


def plain_figure(run: RunSummary, column: ColumnSummary) -> Entry:
    """A cell's own figure."""
    value = run["figures"].get(column["key"])
    if value is None:
        return Entry("n/a", None, reason=run["state"] if not run["figures"] else "the cell has no such figure")
    return Entry(f"{value:.{column['decimals']}f}", sorted_by(value, column))


def training(run: RunSummary) -> Entry:
    """A cell's seconds of training."""
    spent = cost_of(run, "seconds")
    if spent is None:
        return Entry("n/a", None, reason="nothing was trained" if run["state"] == "finished" else run["state"])
    return Entry(f"{spent:.1f}", spent)


def count(run: RunSummary) -> Entry:
    """How many surfels a cell's model has."""
    if run["surfels"] is None:
        return Entry("n/a", None, reason=run["state"])
    return Entry(str(run["surfels"]), run["surfels"])
