"""Measurements of steps in words and as a table."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.table import Table

SCHEMA = "radiogs-bench/steps/1"

MOST_PARTS = 3
"""Parts of a step that a table shows."""

FRAME, SURFELS_ALONE = ": a frame", "by surfels alone"
"""Ending of the titles of frames, and words in the title of those that need no rays."""


def milliseconds(seconds: float) -> str:
    """Three digits and the unit."""
    value, unit = (seconds, "s") if seconds >= 1 else (1e3 * seconds, "ms")
    return f"{value:.{0 if value >= 100 else 1 if value >= 10 else 2}f} {unit}"


def ends(low: float | None, high: float | None) -> str:
    """The ends of an interval of seconds; empty where there is none."""
    return "" if low is None or high is None else f"{milliseconds(low)} to {milliseconds(high)}"


def frames_said(size: Mapping[str, Any]) -> Iterator[str]:
    """How much longer frames take by rays than by surfels alone, a sentence each, for a method that has both ways."""
    frames = [row for row in size["rows"] if row["title"].endswith(FRAME)]
    for alone in (row for row in frames if SURFELS_ALONE in row["title"] and row["median"] > 0):
        for row in (row for row in frames if SURFELS_ALONE not in row["title"]):
            way, other = (each["title"].removesuffix(FRAME) for each in (row, alone))
            ratio = row["median"] / alone["median"]
            yield f"A frame of {way} takes {ratio:.1f} times as long as one of {other}."


def headline(name: str, size: Mapping[str, Any]) -> str:
    """A size in words."""
    surfels = "its own number of surfels" if size["surfels"] is None else f"{size['surfels']:,} surfels"
    return f"{name}: {size['side']} x {size['side']}, {surfels} {size['model']}, {size['views']} views"


def as_table(name: str, size: Mapping[str, Any]) -> "Table":
    """A line for each thing that was done at a size."""
    from rich.table import Table

    table = Table("", title=headline(name, size), title_justify="left")
    for heading in ("median", "95 % interval", "operations", "launches", "page faults"):
        table.add_column(heading, justify="right")
    table.add_column("where its time goes")
    for row in size["rows"]:
        largest = [f"{part} {100 * share:.0f} %" for part, share in row["parts"].items()][:MOST_PARTS]
        table.add_row(
            row["title"], milliseconds(row["median"]), ends(row["low"], row["high"]),
            f"{row['operations']:,}", f"{row['launches']:,}",
            "" if row["page faults"] is None else f"{row['page faults']:,}", ", ".join(largest),
        )  # fmt: skip
    return table
