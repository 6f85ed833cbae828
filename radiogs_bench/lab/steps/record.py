"""Measurements of steps as JSON and as a table."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from .estimates import ratio_of_medians
from .yardsticks import Yardsticks

if TYPE_CHECKING:
    from rich.table import Table

SCHEMA = "radiogs-bench/steps/1"

MOST_PARTS = 3
"""Parts of a step that a table shows."""

FRAME, SURFELS_ALONE = ": a frame", "by surfels alone"
"""Ending of the titles of frames, and words in the title of those that need no rays."""

Plain = dict[str, Any]


def record_of(
    session: Mapping[str, Any], subject: Mapping[str, str], yardsticks: Yardsticks, sizes: Mapping[str, Plain]
) -> Plain:
    """Everything that was measured, and where. ``subject``: method and scene."""
    medians = yardsticks.medians()
    return {
        "schema": SCHEMA,
        **session,
        **subject,
        "yardsticks": {name: {"median": medians[name], "seconds": values} for name, values in yardsticks.found.items()},
        "sizes": dict(sizes),
    }


def milliseconds(seconds: float) -> str:
    """Three digits and the unit."""
    value, unit = (seconds, "s") if seconds >= 1 else (1e3 * seconds, "ms")
    return f"{value:.{0 if value >= 100 else 1 if value >= 10 else 2}f} {unit}"


def ends(low: float | None, high: float | None) -> str:
    """The ends of an interval of seconds; empty where there is none."""
    return "" if low is None or high is None else f"{milliseconds(low)} to {milliseconds(high)}"


def parts_said(parts: Mapping[str, float], most: int = MOST_PARTS) -> str:
    """The parts that take most, in percent."""
    largest = sorted(parts.items(), key=lambda item: -item[1])
    return ", ".join(f"{part} {100 * share:.0f} %" for part, share in largest[:most])


def frames_said(size: Mapping[str, Any]) -> Iterator[str]:
    """How much longer frames take by rays than by surfels alone, a sentence each, for a method that has both ways."""
    frames = [row for row in size["rows"] if row["title"].endswith(FRAME)]
    for alone in (row for row in frames if SURFELS_ALONE in row["title"]):
        for row in (row for row in frames if SURFELS_ALONE not in row["title"]):
            ratio = ratio_of_medians(row["passes"], alone["passes"], paired=True)
            if ratio is not None:
                interval = "" if ratio.low is None else f" ({ratio.low:.1f} to {ratio.high:.1f})"
                way, other = (each["title"].removesuffix(FRAME) for each in (row, alone))
                yield f"A frame of {way} takes {ratio.value:.1f}{interval} times as long as one of {other}."


def headline(name: str, size: Mapping[str, Any]) -> str:
    """A size in words."""
    surfels = "its own number of surfels" if size["surfels"] is None else f"{size['surfels']:,} surfels"
    return f"{name}: {size['side']} x {size['side']}, {surfels} {size['model']}, {size['views']} views"


def yardstick_said(record: Mapping[str, Any]) -> str:
    """The yardsticks' median times as one sentence."""
    return "; ".join(f"{name}: {milliseconds(each['median'])}" for name, each in record["yardsticks"].items())


def as_table(name: str, size: Mapping[str, Any]) -> "Table":
    """A line for each thing that was done at a size."""
    from rich.table import Table

    table = Table("", title=headline(name, size), title_justify="left")
    for heading in ("median", "95 % interval", "operations", "launches", "page faults"):
        table.add_column(heading, justify="right")
    table.add_column("where its time goes")
    for row in size["rows"]:
        table.add_row(
            row["title"], milliseconds(row["median"]), ends(row["low"], row["high"]),
            f"{row['operations']:,}", f"{row['launches']:,}",
            "" if row["page faults"] is None else f"{row['page faults']:,}", parts_said(row["parts"]),
        )  # fmt: skip
    return table
