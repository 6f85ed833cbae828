"""``radiogs-bench status``: how far a run, or a training, is, now or until it has ended."""

import json
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from ..durations import time_left
from .options import Json, MaybeCount
from .reporter import console, say, say_aside, say_whole, show

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import Console
    from rich.table import Table

    from ..results.standing import CellStanding, Standing
    from ..runs.sweep import Sweep
    from ..store.folder import Store

EVERY_SECONDS = 2
"""Seconds between two looks of ``--watch``."""

WIDE = 100
"""Width of the terminal, in characters, from which the table has a column of cell keys."""


def status(out: Path, /, *, as_json: Json = False, watch: MaybeCount = None) -> None:
    """Print the progress of a run: its cells, their steps, and the time left.

    Example:  radiogs-bench status out/ablations --watch

    :param out: Look at the run or the training in this folder.
    :param as_json: Print one JSON object.
    :param watch: Look again every N seconds (default: 2) until no cell is left to do.
    """
    from ..results.standing import as_plain_values
    from ..runs.sweep import has_sweep, read_sweep
    from ..store.folder import Store
    from ..store.pace import paces

    every = None if watch is None else (*watch, EVERY_SECONDS)[0]
    if not has_sweep(out) and (paces(Store(out)) or (out / "trained.json").exists()):
        show_training(out, as_json, every)
        return
    store, sweep = Store(out), read_sweep(out)
    standings = _standings(store, sweep, every)
    if as_json:
        for standing in standings:
            say_whole(json.dumps(as_plain_values(standing, sweep), allow_nan=False))
            sys.stdout.flush()
        return
    if every and sys.stdout.isatty():
        _watch(standings, store, sweep, console())
    else:
        *_, last = standings  # a file gets the end alone
        table, lines = _picture(last, store, sweep, console().width)
        show(table)
        say(*lines)
    say_aside(store)


def _standings(store: "Store", sweep: "Sweep", every: int | None) -> "Iterator[Standing]":
    """Yield the state of a run: once, or at intervals until the run has ended."""
    from ..results.standing import standing_of

    while True:
        standing = standing_of(store, sweep)
        yield standing
        if every is None or standing.ended:
            return
        time.sleep(every)


def _watch(standings: "Iterator[Standing]", store: "Store", sweep: "Sweep", out: "Console") -> None:
    """Draw the table again and again, over the last one."""
    from rich.console import Group
    from rich.live import Live
    from rich.text import Text

    with Live(console=out, auto_refresh=False, vertical_overflow="visible") as screen:
        for standing in standings:
            table, lines = _picture(standing, store, sweep, out.width)
            screen.update(Group(table, *map(Text, lines)), refresh=True)


def _picture(standing: "Standing", store: "Store", sweep: "Sweep", width: int) -> "tuple[Table, list[str]]":
    """The table of cells and the lines below it; it has a column of keys if ``width`` characters are enough for one."""
    from rich.markup import escape
    from rich.table import Table

    from ..runs.sweep import FINISHED, label

    table = Table(title=escape(f"{sweep['title']}, preset {sweep['preset']}"))
    keys = width >= WIDE
    table.add_column("cell", overflow="fold")
    if keys:
        table.add_column("key", no_wrap=True)
    table.add_column("state", overflow="fold")
    moving = any(cell.pace is not None for cell in standing.cells)
    if moving:
        for name in ("step", "a second", "left"):
            table.add_column(name, justify="right", no_wrap=True)
    for cell in standing.cells:
        row = [label(cell.ref), *([cell.ref["key"]] if keys else []), _state(cell)]
        table.add_row(*map(escape, [*row, *_pace(cell)] if moving else row))
    lines = [f"{standing.count(FINISHED)} of {len(standing.cells)} cells finished"]
    if any(cell.left for cell in standing.cells) and standing.ended:
        lines.append("nothing runs: what did was killed; the same command continues it")
    if standing.seconds_left is not None:
        lines.append(f"about {time_left(standing.seconds_left)} left, as cells took that have finished")
    mine = {ref["key"] for ref in sweep["cells"]}
    others = sum(1 for result in store.results() if result["key"] not in mine)
    if others:
        lines.append(f"{others} finished cells of other runs or versions of the code are kept beside them")
    if standing.ended and (page := store.folder / "report.html").exists():
        lines.append(f"open {page}")
    return table, lines


def _state(cell: "CellStanding") -> str:
    """The state in words; for a running cell, its task."""
    if cell.pace is None:
        return cell.state
    silent = f", silent for {time_left(cell.pace.seconds_silent)}" if cell.silent else ""
    return f"{cell.pace.task}{silent}"


def _pace(cell: "CellStanding") -> tuple[str, str, str]:
    """Step, speed, and time left of a running cell's task."""
    pace = cell.pace
    if pace is None:
        return "", "", ""
    speed, left = pace.steps_a_second, pace.seconds_left
    a_second = "" if speed is None else f"{speed:.3g}"
    return f"{pace.done}/{pace.total}", a_second, "" if left is None else time_left(left)


def show_training(folder: Path, plain: bool, every: int | None) -> None:
    """Print how far a training is, as a line or (``plain``) a JSON object, at intervals until it has ended."""
    from ..store.folder import Store
    from ..store.pace import paces

    while True:
        working = paces(Store(folder))
        if plain:
            say_whole(json.dumps({"training": [asdict(pace) for pace in working]}, allow_nan=False))
        else:
            for pace in working:
                left = "" if pace.seconds_left is None else f", about {time_left(pace.seconds_left)} left of it"
                say(f"{pace.task}: {pace.done:,} of {pace.total:,}{left}")
            if not working:
                say(f"trained: see {folder / 'trained.json'}" if (folder / "trained.json").exists() else "stopped")
        if every is None or not working:
            return
        time.sleep(every)
