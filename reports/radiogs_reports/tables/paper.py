"""A table of the paper with its own rows and columns, measured beside published."""

from collections.abc import Iterator
from dataclasses import replace

from ..analysis.findings import compared_paper, headline, sentences_of
from ..summary import PaperColumn, PaperTable, Summary, counted_scenes, protocol_title
from ..wording import mean_over, number
from .doubts import shown_verdict
from .legend import with_legend
from .model import Column, PrintedCell, PrintedRow, Table, difference_of, missing_cell, rank_in_words

SIDE_BY_SIDE = ("views",)
"""Keys of tables with a line per setting and the methods side by side; their rows are stored as method-setting."""


def paper_table(stored: PaperTable, summary: Summary) -> Table:
    """A table of the paper, with the lines and columns that the paper prints."""
    rows = [
        PrintedRow(
            row["text"],
            [_cell(stored, row["key"], column, summary) for column in stored["columns"]],
            row["key"],
            ran=row.get("ran", ""),
            remark=row["remark"],
        )
        for row in stored["rows"]
    ]
    made = Table(
        stored["key"],
        stored["title"],
        [_column(each) for each in stored["columns"]],
        rows,
        caption=_caption(stored, summary),
        source=f"made by radiogs-bench; the paper's {stored['label']}",
        reference=next((row for row in rows if row.key == stored["reference"]), None),
        published_data=stored["data"],
        apart_title=_apart_title(stored, summary),
        headline=headline(compared_paper(stored, summary)),
        findings=sentences_of(compared_paper(stored, summary)),
    )
    made = with_legend(made, counted_scenes(summary))
    printed = _side_by_side(made) if stored["key"] in SIDE_BY_SIDE else made
    return replace(printed, notes=list(dict.fromkeys(each.rstrip(".") for each in _reasons(printed))))


def apart_table(table: Table) -> Table:
    """The published values by other conventions, as a table of their own; without columns if there are none."""
    places = [place for place, column in enumerate(table.columns) if column.published_by]
    rows = []
    for row in table.rows:
        cells = [each for place in places if (each := row.cells[place].apart) is not None]
        rows.append(PrintedRow(row.text, cells, remark=row.remark))
    return Table(table.name, table.apart_title, [table.columns[place] for place in places], rows, notes=table.notes)


def _column(column: PaperColumn) -> Column:
    return Column(
        f"{column['group']} {column['label']}".strip(),
        column["unit"],
        column["direction"],
        column["decimals"],
        key=column["key"],
        group=column["group"],
        name=column["label"],
        published_by=column.get("published_by", ""),
        smallest=None if column["direction"] == "none" else column.get("smallest"),
    )


def _cell(table: PaperTable, row: str, column: PaperColumn, summary: Summary) -> PrintedCell:
    """The measured value with the paper's decimals, and the published value as printed."""
    stored, decimals = table["cells"][row][column["key"]], column["decimals"]
    mean, text, difference = stored["mean"], stored["published"], stored["difference"]
    absent = stored["absent"] or "not published"
    published = missing_cell(absent) if text is None else PrintedCell(text, float(text))
    is_beside = "published_by" not in column
    return replace(
        missing_cell(stored["reason"]) if mean is None else PrintedCell(number(mean, decimals), mean),
        rank=rank_in_words(stored.get("rank")),
        difference=difference_of(difference, decimals, shown_verdict(summary, row, column["key"], difference)),
        published=published if is_beside else None,
        apart=None if is_beside else published,
    )


def _side_by_side(table: Table) -> Table:
    """The table with a line per setting, and with the columns of each metric repeated for each method."""
    methods: dict[str, str] = {}
    settings: dict[str, str] = {}
    for row in table.rows:
        method, _, setting = row.key.rpartition("-")
        methods[method], _, settings[setting] = row.text.partition(", ")
    columns = [
        replace(column, label=f"{column.label} {text}", unit="", group=column.label, name=text)
        for column in table.columns
        for text in methods.values()
    ]
    by_key = {row.key: row for row in table.rows}
    rows = []
    for setting, text in settings.items():
        lines = [by_key[f"{method}-{setting}"] for method in methods]
        ran = next((row.ran for row in table.rows if row.ran and row.key.rpartition("-")[2] == setting), "")
        cells = [line.cells[place] for place in range(len(table.columns)) for line in lines]
        rows.append(PrintedRow(text, cells, setting, ran=ran))
    return replace(table, columns=columns, rows=rows)


def _reasons(table: Table) -> Iterator[str]:
    """Why values are missing, and remarks on rows: line by line, then the separate published values' reasons."""
    for row in table.rows:
        yield from (each.reason for cell in row.cells for each in (cell, cell.published) if each and each.value is None)
        yield from [row.remark] if row.has_published and row.remark else []
    for row in table.rows:
        yield from (cell.apart.reason for cell in row.cells if cell.apart and cell.apart.value is None)
        yield from [row.remark] if table.apart_title and row.remark else []


def _apart_title(table: PaperTable, summary: Summary) -> str:
    """The heading of published values by other conventions than the measured ones; empty without such values."""
    others = {column["published_by"] for column in table["columns"] if "published_by" in column}
    if not others:
        return ""
    return (
        f"Published, by protocol {', '.join(sorted(others))}; measured values are by protocol {protocol_title(summary)}"
        " and are not to be compared with these"
    )


def _caption(table: PaperTable, summary: Summary) -> str:
    """Data, seeds, protocol, and the source of published values; plain text."""
    seeds = ", ".join(map(str, summary["seeds"]))
    text = (
        f"{table['title']}. Measured: mean over {mean_over(summary)} ({seeds}), preset {summary['preset']}, metric"
        f" protocol {protocol_title(summary)}."
    )
    reference = next((row["text"] for row in table["rows"] if row["key"] == table["reference"]), None)
    differences = [value["difference"] for row in table["cells"].values() for value in row.values()]
    if reference is not None and any(differences):
        text += f" Below it: paired difference to {reference}"
        several = any(each is not None and each["low"] is not None for each in differences)
        text += " and half-width of its 95 % t interval." if several else "; a single seed gives no interval."
    return f"{text} Paper: as published, {table['data']}."
