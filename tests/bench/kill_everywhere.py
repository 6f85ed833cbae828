"""Run a small sweep, killed (SIGKILL) at every event of its writing in turn, and continued; report as JSON.

Started by ``test_damage.py`` with a folder. It forks, so that torch is imported once.
"""

import hashlib
import json
import os
import signal
import sys
from pathlib import Path
from typing import Any

from bench.fake_method import CPU, FakeSweep, fake_cell
from radiogs.settings import Variant
from radiogs_bench.store.folder import Store
from radiogs_bench.store.provenance import session

CELLS = [fake_cell(), fake_cell(variant=Variant(radiometric_weight=0.0))]


class Executioner:
    """Counts the changes of the store and kills its process at one of them."""

    def __init__(self, deadly: int) -> None:
        self.deadly, self.events = deadly, 0
        self.fsync, self.replace, self.unlink = os.fsync, Path.replace, Path.unlink

    def event(self) -> None:
        self.events += 1
        if self.events == self.deadly:
            os.kill(os.getpid(), signal.SIGKILL)

    def attach(self) -> None:
        def fsync(descriptor: int) -> None:
            if self.events + 1 == self.deadly and os.path.isfile(f"/proc/self/fd/{descriptor}"):
                os.ftruncate(descriptor, os.fstat(descriptor).st_size // 2)  # a write that the kernel had half done
            self.event()
            self.fsync(descriptor)

        def replace(source: Path, target: Path) -> Path:
            self.event()
            return self.replace(source, target)

        def unlink(path: Path, missing_ok: bool = False) -> None:
            self.event()
            self.unlink(path, missing_ok)

        os.fsync = fsync  # type: ignore[assignment]
        Path.replace = replace  # type: ignore[method-assign, assignment]
        Path.unlink = unlink  # type: ignore[method-assign]


def sweep(folder: Path, deadly: int) -> int:
    """Run the cells in a child that dies at event ``deadly``; returns how many events there were, 0 if it died."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        executioner = Executioner(deadly)
        executioner.attach()
        FakeSweep(folder).run(CELLS)
        os.write(writer, str(executioner.events).encode())
        os._exit(0)
    os.close(writer)
    os.waitpid(child, 0)
    events = os.read(reader, 100)
    os.close(reader)
    return int(events or b"0")


def finished(folder: Path) -> dict[str, str]:
    """Digest of each result file."""
    return {
        path.stem: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted((folder / "cells").glob("*.json"))
    }


def table(folder: Path) -> list[Any]:
    """The results of the sweep without times and speeds."""
    store = Store(folder)
    return [
        [each["key"], each["metrics"], each["work"], each["losses"],
         hashlib.sha256(store.arrays_path(each["key"]).read_bytes()).hexdigest()]
        for each in store.results()
    ]  # fmt: skip


def main(folder: Path) -> None:
    session(CPU)  # asks git once, for all children
    events = sweep(folder / "whole", deadly=0)
    report: dict[str, Any] = {"events": events, "table": table(folder / "whole"), "killed": []}
    for deadly in range(1, events + 1):
        place = folder / str(deadly)
        survived = sweep(place, deadly)
        before = finished(place)
        sweep(place, deadly=0)
        after = finished(place)
        report["killed"].append(
            {
                "deadly": deadly,
                "survived": survived,
                "repeated": [key for key in before if before[key] != after.get(key)],
                "same": table(place) == report["table"],
                "left": sorted(
                    path.name for path in place.rglob("*") if path.name.endswith((".tmp", ".checkpoint.pt"))
                ),
                "aside": (place / "aside").exists(),
            }
        )
    sys.stdout.write(json.dumps(report))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
