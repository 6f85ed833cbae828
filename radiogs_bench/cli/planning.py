"""The dry run and the list of suites: cells, finished or not, and estimates of time and memory."""

from collections.abc import Sequence
from dataclasses import asdict

from rich.table import Table

from ..durations import duration
from ..runs.forecast import Expected, forecast, total
from ..runs.sweep import Request, label, state_of
from ..store.folder import Store
from ..suites.suite import Suite
from .events import emit
from .reporter import say, show

UNKNOWN = "unknown"


def show_plan(request: Request, store: Store, at_a_time: int, threads: int) -> None:
    """Print every cell, its state, and estimates from what the store has measured.

    ``at_a_time`` cells run at the same time, each on ``threads`` threads.
    """
    cells = request.own_cells()
    expected = forecast(store, [cell for _, cell in cells])
    table = Table("cell", "key", "state", "time", "memory", title=f"{request.suite.title}, preset {request.preset}")
    for (place, _), each in zip(cells, expected, strict=True):
        row = ("", "") if each is None else (UNKNOWN if each.seconds is None else duration(each.seconds), memory(each))
        table.add_row(label(place), place["key"], state_of(store, place), *row)
    show(table)
    missing = sum(each is not None for each in expected)
    say(f"{missing} of {len(cells)} cells to run")
    if missing:
        say(f"time, one after the other: {whole_time(expected)}{how_measured(store, threads)}")
        if at_a_time > 1:
            say(f"time, {at_a_time} at a time: {whole_time(expected, at_a_time)}")
        say(f"memory of one process: {whole_memory(expected)}")


def emit_plan(request: Request, store: Store) -> None:
    """One event per cell, with null for unknown values."""
    cells = request.own_cells()
    for (place, cell), each in zip(cells, forecast(store, [cell for _, cell in cells]), strict=True):
        rest = {} if each is None else asdict(each)
        emit("planned", cell=label(place), key=cell.key, state=state_of(store, place), **rest)


def emit_suite(suite: Suite) -> None:
    """One event for a suite."""
    emit(
        "suite",
        name=suite.name,
        title=suite.title,
        rows=[row.key for row in suite.rows],
        columns=[metric.key for metric in suite.columns],
        scenes=list(suite.scenes),
        protocol=suite.protocol,
        download=suite.download,
    )


def how_measured(store: Store, threads: int) -> str:
    """A remark if the store's cells ran on another number of threads: their seconds are then not comparable."""
    seen = {
        session["machine"]["threads"]
        for result in store.results()
        for sessions in result["sessions"].values()
        for session in sessions
    }
    if seen <= {threads}:
        return ""
    return f" (measured on {' or '.join(map(str, sorted(seen)))} threads a cell; here a cell has {threads})"


def whole_time(expected: Sequence[Expected | None], at_a_time: int = 1) -> str:
    """Time of all missing cells; cells run at a time share the work evenly, or the longest one decides."""
    seconds, unknown = total(expected)
    longest = max((each.seconds or 0.0 for each in expected if each is not None), default=0.0)
    seconds = max(seconds / at_a_time, longest)
    missing = sum(each is not None for each in expected)
    if unknown == missing:
        return f"{UNKNOWN} (the store has measured nothing like it)"
    return f"about {duration(seconds)}" + (f", and {unknown} cells of which it is {UNKNOWN}" if unknown else "")


def whole_memory(expected: Sequence[Expected | None]) -> str:
    """Largest memory estimate of any missing cell."""
    known = [each for each in expected if each is not None and each.host_bytes is not None]
    if not known:
        return UNKNOWN
    most = max(known, key=lambda each: (each.host_bytes or 0, each.device_bytes or 0))
    return f"up to {memory(most)}"


def memory(expected: Expected) -> str:
    """Memory of the host, and of the GPU if one was used."""
    if expected.host_bytes is None:
        return UNKNOWN
    device = "" if expected.device_bytes is None else f", GPU {expected.device_bytes / 2**30:.2f} GiB"
    return f"{expected.host_bytes / 2**30:.2f} GiB{device}"


def describe(suite: Suite) -> list[str]:
    """A suite in a few lines: title, rows, columns, scenes and where to find them, and its protocol unless default."""
    return [
        f"{suite.name}: {suite.title} ({len(suite.rows)} rows, {len(suite.columns)} metrics)",
        f"  rows: {', '.join(row.key for row in suite.rows)}",
        f"  columns: {', '.join(metric.key for metric in suite.columns)}",
        f"  scenes: {', '.join(suite.scenes)}",
        *([f"  download: {suite.download}"] if suite.download else []),
        *([f"  protocol: {suite.protocol}"] if suite.protocol != "default" else []),
    ]
