"""Measurements beside others of the same machine: ratios of medians, and whether the same work was done."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radiogs_core.errors import DataError, UsageError

from ...store.seal import Broken, OtherSchema, read_sealed
from .estimates import Ranged, ratio_of_medians
from .record import SCHEMA, milliseconds

if TYPE_CHECKING:
    from rich.table import Table

AGAINST = "radiogs-bench/steps-against/1"
"""Schema of a record of two checkouts."""

MACHINE = ("cpu", "cores", "memory_bytes", "gpu", "threads")
"""Properties that two machines have to share for their seconds to be compared."""

MODEL = ("preset", "side", "views", "surfels", "model")

OTHER_WORK = 0.02
"""Difference of a work counter, as a share, that is told."""

Plain = dict[str, Any]


def read_record(path: Path) -> Plain:
    """A record of ``bench steps --json``. Raises DataError for any other file."""
    make = "Make one:  radiogs-bench bench steps --json FILE"
    try:
        return read_sealed(path, SCHEMA, ("machine", "method", "scene", "sizes"))
    except FileNotFoundError:
        raise DataError(f"there is no record {path}", "", make) from None
    except OtherSchema as error:
        raise DataError(f"{path} is no record of this version ({SCHEMA})", error.what, make) from error
    except Broken as broken:
        raise DataError(f"cannot use the record {path}: {broken.reason}", "", make) from broken


def require_comparable(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> None:
    """Raise UsageError where two records are of other machines, methods or scenes."""
    differing = [name for name in MACHINE if ours["machine"].get(name) != theirs["machine"].get(name)]
    differing += [name for name in ("method", "scene") if ours[name] != theirs[name]]
    if differing:
        raise UsageError(
            f"the two records differ in {', '.join(differing)}",
            "Seconds are compared on one machine, of one method on one scene.",
            "Measure both here:  radiogs-bench bench steps --against CHECKOUT",
        )


def compared(ours: Plain, theirs: Plain, paired: bool) -> Iterator[Plain]:
    """Ratio of medians, theirs over ours, for everything that both did at one size; its value is None where it took
    less than a tick of the clock.

    Raises UsageError where the models or the images differ.
    """
    differing = [name for name in MODEL if ours[name] != theirs[name]]
    if differing:
        said = ", ".join(f"{name} {ours[name]} against {theirs[name]}" for name in differing)
        raise UsageError(f"the two did not measure the same: {said}", "", "Measure both with the same versions.")
    before = {row["title"]: row for row in theirs["rows"]}
    for row in ours["rows"]:
        if row["title"] in before:
            earlier = before[row["title"]]
            ratio = ratio_of_medians(earlier["passes"], row["passes"], paired)
            yield {
                "title": row["title"],
                **(ratio._asdict() if ratio else dict.fromkeys(Ranged._fields)),
                "before": earlier["median"],
                "now": row["median"],
                "operations": [earlier["operations"], row["operations"]],
                "launches": [earlier["launches"], row["launches"]],
                "other work": _other_work(earlier["work"], row["work"]),
            }


def _other_work(before: Mapping[str, int], now: Mapping[str, int]) -> dict[str, float]:
    """Work counters that changed, as ratios to what they were."""
    found = {name: now[name] / before[name] for name in now if before.get(name)}
    return {name: ratio for name, ratio in found.items() if abs(ratio - 1) > OTHER_WORK}


def as_table(name: str, ratios: list[Plain]) -> "Table":
    """A line for each thing; ratios above 1 are faster now."""
    from rich.table import Table

    table = Table("", title=name, title_justify="left")
    for heading in ("before", "now", "times as fast", "95 % interval", "operations", "launches"):
        table.add_column(heading, justify="right")
    table.add_column("work that changed")
    for each in ratios:
        interval = "" if each["low"] is None else f"{each['low']:.2f} to {each['high']:.2f}"
        table.add_row(
            each["title"], milliseconds(each["before"]), milliseconds(each["now"]),
            "too short" if each["value"] is None else f"{each['value']:.2f}", interval,
            *(f"{before:,} → {now:,}" for before, now in (each["operations"], each["launches"])),
            ", ".join(f"{what} x {ratio:.2f}" for what, ratio in each["other work"].items()),
        )  # fmt: skip
    return table
