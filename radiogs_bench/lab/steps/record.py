"""Measurements of steps in words and as a table, alone and beside an earlier record of the same machine."""

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radiogs_core.errors import UsageError

from ...store.seal import read_kept

if TYPE_CHECKING:
    from rich.table import Table

SCHEMA = "radiogs-bench/steps/1"

MOST_PARTS = 3
"""Parts of a step that a table shows."""

FRAME, SURFELS_ALONE = ": a frame", "by surfels alone"
"""Ending of the titles of frames, and words in the titles of frames without rays."""

MACHINE = ("cpu", "cores", "memory_bytes", "gpu", "threads")
"""Properties that two machines have to share for their seconds to be compared."""

MODEL = ("preset", "side", "views", "surfels", "model")

OTHER_WORK = 0.02
"""Relative difference of a work counter from which a note names it."""

Plain = dict[str, Any]


def milliseconds(seconds: float) -> str:
    """Three digits and the unit."""
    value, unit = (seconds, "s") if seconds >= 1 else (1e3 * seconds, "ms")
    return f"{value:.{0 if value >= 100 else 1 if value >= 10 else 2}f} {unit}"


def ends(low: float | None, high: float | None) -> str:
    """The ends of an interval of seconds; empty without an interval."""
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
    """A table of measurements at one size, one line per piece of work."""
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


def read_record(path: Path) -> Plain:
    """A record of ``bench steps --json``. Raises DataError for any other file."""
    keys = ("machine", "method", "scene", "sizes")
    return read_kept(path, "record", SCHEMA, keys, "Make one:  radiogs-bench bench steps --json FILE")


def comparable_sizes(ours: Mapping[str, Any], theirs: Mapping[str, Any], wanted: Collection[str]) -> dict[str, Plain]:
    """A record's measurements at the wanted sizes. Raises UsageError for none, or other machines, methods or scenes."""
    differing = [name for name in MACHINE if ours["machine"].get(name) != theirs["machine"].get(name)]
    differing += [name for name in ("method", "scene") if ours[name] != theirs[name]]
    if differing:
        raise UsageError(
            f"the two records differ in {', '.join(differing)}",
            "Seconds are compared on one machine, of one method on one scene.",
            "Measure the earlier checkout here:  radiogs-bench bench steps --json FILE",
        )
    found = {name: size for name, size in theirs["sizes"].items() if name in wanted}
    if not found:
        there = ", ".join(theirs["sizes"])
        raise UsageError("the record has none of these sizes", f"It has: {there}.", "Name them with --sizes.")
    return found


def ratio_table(name: str, ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> "Table":
    """Speed-ups of what both did at a size; above 1 is faster now. Raises UsageError for other models or images."""
    from rich.table import Table

    differing = [f"{name} {ours[name]} against {theirs[name]}" for name in MODEL if ours[name] != theirs[name]]
    if differing:
        what = f"the two did not measure the same: {', '.join(differing)}"
        raise UsageError(what, "", "Measure both with the same versions.")
    table = Table("", title=name, title_justify="left")
    for heading in ("before", "now", "times as fast", "from both intervals", "operations", "launches"):
        table.add_column(heading, justify="right")
    table.add_column("work that changed")
    earlier = {row["title"]: row for row in theirs["rows"]}
    for now in ours["rows"]:
        if (before := earlier.get(now["title"])) is not None:
            was = before["work"]
            changed = {what: count / was[what] for what, count in now["work"].items() if was.get(what)}
            table.add_row(
                now["title"], milliseconds(before["median"]), milliseconds(now["median"]), *times_as_fast(before, now),
                *(f"{before[count]:,} → {now[count]:,}" for count in ("operations", "launches")),
                ", ".join(f"{what} x {ratio:.2f}" for what, ratio in changed.items() if abs(ratio - 1) > OTHER_WORK),
            )  # fmt: skip
    return table


def times_as_fast(before: Mapping[str, Any], now: Mapping[str, Any]) -> tuple[str, str]:
    """The ratio of the medians before and now, and the least and the most that the intervals of both allow."""
    if not (before["median"] > 0 and now["median"] > 0):
        return "too short", ""
    ratio = f"{before['median'] / now['median']:.2f}"
    if not (before["low"] and now["low"]):
        return ratio, ""
    return ratio, f"{before['low'] / now['high']:.2f} to {before['high'] / now['low']:.2f}"
