"""Run a sweep of the fake method where the disk is full, give it room, and continue; report as JSON.

Started by ``test_damage.py`` with a folder and what is to be scarce:

    space   a small tmpfs, mounted on the folder: the disk as a whole is full. Needs the right to mount, which
            ``unshare --map-root-user --mount`` gives where the kernel lets users have namespaces.
    size    RLIMIT_FSIZE: no file may become larger. Always possible; the kernel refuses in the middle of a write, as
            on a full disk, and with an error of the same kind.

Every size is tried, from one at which nothing fits to one at which everything does.
"""

import json
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from bench.fake_method import CPU, FakeSweep, asked
from bench.kill_at_random import kept, unreadable
from bench.kill_everywhere import table
from radiogs_bench.errors import StoreError
from radiogs_bench.store.provenance import session

UNSHARE = ("unshare", "--map-root-user", "--mount")
"""A namespace of mounts: what is mounted goes with the process, also when it is killed."""


def why_nothing_can_be_mounted(folder: Path) -> str | None:
    """The reason why no small tmpfs can be mounted; None if one can."""
    missing = [name for name in ("unshare", "mount", "umount") if shutil.which(name) is None]
    if missing:
        return f"there is no program {', '.join(missing)}"
    command = [*UNSHARE, "mount", "-t", "tmpfs", "-o", "size=4096", "none", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return None if done.returncode == 0 else f"no tmpfs can be mounted here: {done.stderr.strip()}"


CELLS = [cell for _, cell in asked().cells]
UNLIMITED = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
STEPS = {"space": 8192, "size": 1024}
"""Bytes between two attempts; a tmpfs only has room for whole pages of 4096."""


def attempt(folder: Path, limit: Callable[[], None]) -> str:
    """Run the sweep in a child under a limit; returns "done", what it complained of, or its traceback's last line."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
        try:
            limit()
            failures = FakeSweep(folder).run(CELLS)
            said = "done" if not failures else f"cells failed: {failures[0].what}"
        except StoreError as error:
            said = f"StoreError: {error.what} {error.remedy}"
        except BaseException as error:  # noqa: BLE001
            said = repr(error)
        os.write(writer, said.encode())
        os._exit(0)
    os.close(writer)
    os.waitpid(child, 0)
    with os.fdopen(reader) as pipe:
        return pipe.read()


def mount(folder: Path, option: str) -> None:
    subprocess.run(["mount", "-t", "tmpfs", "-o", option, "none", str(folder)], check=True)


def no_limit() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, UNLIMITED)


def scarce(place: Path, what: str, size: int) -> tuple[Callable[[], None], Callable[[], None]]:
    """How to limit a child, and how to give room afterwards."""
    place.mkdir()
    if what == "space":
        mount(place, f"size={size}")
        return no_limit, lambda: mount(place, "remount,size=64m")
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY)), no_limit


def main(folder: Path, what: str) -> None:
    session(CPU)  # asks git once, for all children
    folder.mkdir(exist_ok=True)
    assert attempt(folder / "whole", no_limit) == "done"
    whole = table(folder / "whole")
    report: dict[str, Any] = {"cells": len(whole), "tried": []}
    while not report["tried"] or report["tried"][-1]["said"] != "done":
        size = STEPS[what] * (len(report["tried"]) + 1)
        place = folder / str(size)
        with ExitStack() as mounted:
            limit, give_room = scarce(place, what, size)
            if what == "space":
                mounted.callback(subprocess.run, ["umount", str(place)], check=True)
            said = attempt(place, limit)
            before, bad = kept(place), unreadable(place)
            left = sorted(path.name for path in place.rglob("*.tmp"))
            give_room()
            again = attempt(place, no_limit)
            after = kept(place)
            report["tried"].append(
                {
                    "size": size,
                    "said": said,
                    "again": again,
                    "finished": sum(name.endswith(".json") for name in before),
                    "unreadable": bad,
                    "left": left,
                    "repeated": [name for name in before if before[name] != after.get(name)],
                    "same": table(place) == whole,
                    "aside": (place / "aside").exists(),
                }
            )
    sys.stdout.write(json.dumps(report))


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
