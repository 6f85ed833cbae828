"""What all forms of a table of the paper share: figures as text, ranks, and what stands below it."""

from itertools import groupby

from ...summary import PaperColumn, PaperFigure, PaperTable, Summary
from ..plain import count_of, signed_figure


def measured(figure: PaperFigure, column: PaperColumn) -> str | None:
    """The measured figure with the paper's number of digits; two significant ones where those would be all zeros."""
    mean = figure["mean"]
    if mean is None:
        return None
    text = f"{mean:.{column['decimals']}f}"
    return f"{mean:.2g}" if float(text) == 0 and mean != 0 else text


def reach(figure: PaperFigure) -> float | None:
    """Half-width of the interval of the difference to the reference row."""
    interval = figure["difference"]
    if interval is None or interval["low"] is None or interval["high"] is None:
        return None
    return (interval["high"] - interval["low"]) / 2


def change(figure: PaperFigure, column: PaperColumn, plus_minus: str) -> str:
    """The paired difference with its half-width; empty where there is none."""
    difference, half = figure["difference"], reach(figure)
    if difference is None:
        return ""
    text = signed_figure(difference["mean"], column["decimals"])
    return text if half is None else f"{text}{plus_minus}{half:.{column['decimals']}f}"


def ranks(table: PaperTable, column: PaperColumn, *, of_published: bool) -> dict[str, int]:
    """First to third by row, of the figures as printed; equal print has equal rank. One row alone has no rank."""
    if column["direction"] == "none":
        return {}
    found = {}
    for row, cells in table["cells"].items():
        figure = cells[column["key"]]
        text = figure["published"] if of_published else measured(figure, column)
        if text is not None:
            found[row] = float(text)
    if len(found) < 2:
        return {}
    order = sorted(set(found.values()), reverse=column["direction"] == "up")
    return {row: order.index(value) + 1 for row, value in found.items() if order.index(value) < 3}


def groups(table: PaperTable) -> list[tuple[str, int]]:
    """The headings that neighbouring columns share, and how many columns each spans."""
    return [(group, len(list(columns))) for group, columns in groupby(table["columns"], key=lambda each: each["group"])]


def reference_text(table: PaperTable) -> str | None:
    """What the row is called that differences are taken to."""
    return next((row["text"] for row in table["rows"] if row["key"] == table["reference"]), None)


def caption(table: PaperTable, summary: Summary) -> str:
    """What the figures are: data, seeds, protocol, interval, and where the published ones come from; plain text."""
    seeds, scenes = summary["seeds"], summary["scenes"]
    pairs = max(figure["count"] for row in table["cells"].values() for figure in row.values())
    text = (
        f"{table['title']}. Measured: mean over {count_of(len(scenes), 'scene')} ({', '.join(scenes)}) and"
        f" {count_of(len(seeds), 'seed')} ({', '.join(map(str, seeds))}), preset {summary['preset']}, metric protocol"
        f" {summary['protocol']}."
    )
    reference = reference_text(table)
    compared = any(figure["difference"] for row in table["cells"].values() for figure in row.values())
    if reference is not None and compared:
        text += f" Below it: paired difference to {reference}"
        text += (
            f" and half-width of its 95 % t interval over {pairs} pairs of scene and seed."
            if pairs > 1
            else "; one pair of scene and seed gives no interval."
        )
    return f"{text} Paper: as published, {table['data']}."
