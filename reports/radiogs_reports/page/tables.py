"""The tables of the page: the suite's, the paper's, the grids of the analyses, and the table of all cells."""

from dataclasses import replace

from ..analysis.report import Grid
from ..analysis.samples import cost_of
from ..summary import PaperTable, Summary, row_texts
from ..tables.model import Column, PrintedCell, PrintedRow, Table, missing_cell
from ..tables.paper import apart_table, paper_table
from ..tables.suite import TRAINING, training_cell, value_cell
from ..wording import marked


def paper_tables(stored: PaperTable, summary: Summary) -> list[Table]:
    """A table of the paper, and a second one of published values if there are any by other conventions."""
    table = paper_table(stored, summary)
    data, key, title = table.published_data, table.name, table.title
    measured = replace(table, name=f"paper-{key}")
    if not table.apart_title:
        return [measured]
    published = replace(
        apart_table(table),
        name=f"published-{key}",
        title=f"{title}: published values",
        caption=f"{table.apart_title}: {data}.",
    )
    return [measured, published]


def grid_table(grid: Grid) -> Table:
    """A grid of derived values; a column sorts by number if all of its known values are numbers."""
    columns = [
        Column(text, numeric=not any(isinstance(row[place].value, str) for row in grid.rows))
        for place, text in enumerate(grid.heads)
    ]
    rows = [
        PrintedRow(label.text, [PrintedCell(item.text, item.value, item.reason) for item in items])
        for label, *items in grid.rows
    ]
    return Table(f"grid-{grid.name}", grid.title, columns[1:], rows, grid.note, lead=grid.heads[0])


def cells_table(summary: Summary) -> Table:
    """Every cell with its metric values; its name opens its provenance."""
    texts = row_texts(summary)
    columns = [
        Column("scene", numeric=False),
        Column("seed"),
        *(Column(**each) for each in summary["columns"]),
        TRAINING,
        Column("surfels"),
        Column("state", numeric=False),
    ]
    rows = []
    for run in summary["runs"]:
        surfels, state, finished = run["surfels"], run["state"], run["state"] == "finished"
        absent = "the cell has no such value" if run["metrics"] else state
        uncounted = missing_cell("the result holds no number of surfels" if finished else state)
        cells = [
            PrintedCell(marked(summary, run["scene"]), run["scene"]),
            PrintedCell(str(run["seed"]), run["seed"]),
            *(value_cell(run["metrics"].get(column["key"]), column, absent) for column in summary["columns"]),
            training_cell(cost_of(run, "seconds"), "nothing was trained" if finished else state),
            uncounted if surfels is None else PrintedCell(f"{surfels:,}", surfels),
            PrintedCell(state, state),
        ]
        rows.append(PrintedRow(texts[run["row"]], cells, opens=run["key"]))
    return Table("cells", "", columns, rows, "Every cell of the run")
