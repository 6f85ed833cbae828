"""Run a sweep of the fake method, killed (SIGKILL) from outside at random moments, and continued; report as JSON.

Started by ``test_damage.py`` with a folder, a number of kills, and how many processes work on one store at a time. It
forks, so that torch is imported once. Sweeps are begun, one after the other, until as many kills have struck.
"""

import json
import os
import random
import signal
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from bench.fake_method import CPU, FakeSweep, asked
from bench.kill_everywhere import table
from radiogs_bench.runs.engines import in_process as engine
from radiogs_bench.store.provenance import session

CELLS = [cell for _, cell in asked(2).cells]

POLL_SECONDS = 0.01
"""How long a process waits for another one's cell; a run's second would be longer than the whole sweep."""

SHARE = 0.5
"""Latest moment of a kill, as a share of the time of an undisturbed sweep. A sweep is killed several times."""

STUCK_SECONDS = 60.0
"""Who has written nothing in this time hangs."""


def start(folder: Path) -> int:
    """Begin or continue the sweep in a child; returns its process id."""
    child = os.fork()
    if child == 0:
        engine.POLL_SECONDS = POLL_SECONDS
        code = 1
        try:
            sys.stderr = open(os.devnull, "w")  # noqa: SIM115
            code = 1 if FakeSweep(folder).run(CELLS) else 0
        finally:
            os._exit(code)
    return child


def kept(folder: Path) -> dict[str, tuple[int, int]]:
    """Every file that says something is finished, by inode and time of writing: who writes it again changes both."""
    files = [path for path in folder.rglob("*") if path.suffix in (".json", ".npz", ".pt") and path.parent != folder]
    done = [path for path in files if "checkpoint" not in path.name and not path.name.startswith(".")]
    done = [path for path in done if path.suffix != ".npz" or path.with_suffix(".json").exists()]
    return {str(path.relative_to(folder)): (path.stat().st_ino, path.stat().st_mtime_ns) for path in done}


def written_at(folder: Path) -> dict[str, int]:
    """Every file of the store, finished or not, with the time of its writing."""
    return {str(path): path.stat().st_mtime_ns for path in folder.rglob("*.*") if path.is_file()}


def unreadable(folder: Path) -> list[str]:
    """Finished results whose JSON or arrays cannot be read."""
    bad = []
    for path in sorted((folder / "cells").glob("*.json")):
        try:
            json.loads(path.read_bytes())
            with np.load(path.with_suffix(".npz")) as arrays:
                list(arrays.values())
        except (OSError, ValueError) as error:
            bad.append(f"{path.name}: {error}")
    return bad


def strike(folder: Path, moments: list[float]) -> tuple[int, list[int]]:
    """Start a process for each moment (seconds from now) and kill it then.

    Returns how many kills struck, and the exit codes of those that had ended before.
    """
    begun = time.monotonic()
    children = [start(folder) for _ in moments]
    codes = []
    for moment, child in sorted(zip(moments, children, strict=True)):
        time.sleep(max(0.0, begun + moment - time.monotonic()))
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        if not os.WIFSIGNALED(status):
            codes.append(os.WEXITSTATUS(status))
    return len(moments) - len(codes), codes


def main(folder: Path, kills: int, processes: int, seed: int = 0) -> None:
    session(CPU)  # asks git once, for all children
    begun = time.monotonic()
    _, status = os.waitpid(start(folder / "whole"), 0)
    assert status == 0
    share = SHARE * (time.monotonic() - begun)
    whole, chance = table(folder / "whole"), random.Random(seed)
    report: dict[str, Any] = {"cells": len(whole), "kills": 0, "sweeps": []}
    while report["kills"] < kills:
        place = folder / str(len(report["sweeps"]))
        sweep: dict[str, Any] = {"kills": 0, "repeated": [], "unreadable": [], "codes": []}
        before: dict[str, tuple[int, int]] = {}
        latest, written = share, written_at(place)
        while not sweep["codes"]:
            struck, sweep["codes"] = strike(place, [chance.uniform(0, latest) for _ in range(processes)])
            sweep["kills"] += struck
            after = kept(place)
            sweep["repeated"] += [name for name in before if before[name] != after.get(name)]
            sweep["unreadable"] += unreadable(place)
            before = after
            if written == (written := written_at(place)):
                latest *= 2  # a busy machine may take longer to its first write than the whole sweep took before
                assert latest < STUCK_SECONDS, f"nothing is written any more in {place}"
        sweep["same"] = table(place) == whole
        sweep["left"] = sorted(
            path.name for path in place.rglob("*") if path.name.endswith((".tmp", ".checkpoint.pt", ".failed.json"))
        )
        sweep["aside"] = (place / "aside").exists()
        report["kills"] += sweep["kills"]
        report["sweeps"].append(sweep)
    sys.stdout.write(json.dumps(report))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
