"""What all forms of a table of the paper share: printed values, headings and the caption."""

from collections.abc import Sequence
from itertools import groupby

from ..summary import PaperColumn, PaperTable, PaperValue, Summary, half_width
from ..wording import ARROWS, count_of, plus_minus, signed


def measured(value: PaperValue, column: PaperColumn) -> str | None:
    """The measured mean with the paper's decimals; with two significant digits where those decimals would all be 0."""
    mean = value["mean"]
    if mean is None:
        return None
    text = f"{mean:.{column['decimals']}f}"
    return f"{mean:.2g}" if float(text) == 0 and mean != 0 else text


def change(value: PaperValue, column: PaperColumn, sign: str) -> str:
    """The paired difference and, after ``sign``, the half-width of its interval; empty without a difference."""
    difference, decimals = value["difference"], column["decimals"]
    if difference is None:
        return ""
    return plus_minus(signed(difference["mean"], decimals), half_width(difference), decimals, sign)


def heading(column: PaperColumn) -> str:
    """Group, label, arrow towards better values, unit."""
    arrow = f" {ARROWS[column['direction']]}" if ARROWS[column["direction"]] else ""
    unit = f" ({column['unit']})" if column["unit"] else ""
    return f"{column['group']} {column['label']}".strip() + arrow + unit


def is_beside(column: PaperColumn) -> bool:
    """Whether published and measured values of a column are by the same conventions, and so stand beside each other."""
    return "published_by" not in column


def row_label(row: dict[str, str]) -> str:
    """The label of a row's measured values: the paper's, or what ran if that is something else."""
    return row.get("ran") or row["text"]


def apart(table: PaperTable, summary: Summary) -> str:
    """The heading of published values that are by other conventions than the measured ones; empty if there are none."""
    others = {column["published_by"] for column in table["columns"] if "published_by" in column}
    return (
        f"Published, by protocol {', '.join(sorted(others))}; measured values are by protocol {summary['protocol']} and"
        " are not to be compared with these"
        if others
        else ""
    )


def groups_of(columns: Sequence[PaperColumn]) -> list[tuple[str, int]]:
    """Headings that neighbouring columns share, and how many columns each spans."""
    return [(group, len(list(columns))) for group, columns in groupby(columns, key=lambda each: each["group"])]


def caption(table: PaperTable, summary: Summary) -> str:
    """Data, seeds, protocol, and the source of published values; plain text."""
    seeds, scenes = summary["seeds"], summary["scenes"]
    text = (
        f"{table['title']}. Measured: mean over {count_of(len(scenes), 'scene')} ({', '.join(scenes)}) and"
        f" {count_of(len(seeds), 'seed')} ({', '.join(map(str, seeds))}), preset {summary['preset']}, metric protocol"
        f" {summary['protocol']}."
    )
    reference = next((row["text"] for row in table["rows"] if row["key"] == table["reference"]), None)
    differences = [value["difference"] for row in table["cells"].values() for value in row.values()]
    if reference is not None and any(differences):
        text += f" Below it: paired difference to {reference}"
        several = any(each is not None and each["low"] is not None for each in differences)
        text += " and half-width of its 95 % t interval." if several else "; a single seed gives no interval."
    return f"{text} Paper: as published, {table['data']}."
