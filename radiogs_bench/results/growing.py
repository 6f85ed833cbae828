"""Reports that grow during a run: they are rewritten whenever all rows of another scene are finished.

A separate process writes them, over the complete scenes alone and without pictures, so that its errors and its memory
do not affect the run or the peaks that cells measure.
"""

import json
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

from ..child_process import CHILD
from ..errors import StoreError
from ..runs.plan import RunPlan
from ..runs.progress import ForwardingProgress, Progress
from ..runs.sweep import CellRef
from ..store.folder import Store
from ..store.schema import Failure

PAUSE = 20.0
"""Shortest pause between two writings of the reports, in units of the time that the last one took: growing costs a run
at most a twentieth of its time."""

FIRST_SECONDS = 60.0
"""Shortest time from the beginning of a run to its first table; a shorter run shows only the table at its end."""

LONGEST_SECONDS = 600.0
"""Time after which the writing process is ended, because the run waits for it."""

Report = Callable[[Sequence[str]], str]
"""Writes the reports over some scenes; returns the text that it prints. Raises StoreError."""


class GrowingReports(ForwardingProgress):
    """Forwards progress; when a further scene is complete, reports it and has the reports written.

    A scene is complete once each of its cells has finished, or has failed in this run. The lines that ``report`` prints
    are shown once, for the first table, or never without ``table``. The last scene is left to the end of the run, which
    writes its reports in any case.
    """

    def __init__(
        self, progress: Progress, store: Store, refs: Sequence[CellRef], report: Report, table: bool = True,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        super().__init__(progress)
        self.store, self.report, self.table, self.clock = store, report, table, clock
        self.scenes = list(dict.fromkeys(ref["scene"] for ref in refs))
        self.open = {scene: [ref["key"] for ref in refs if ref["scene"] == scene] for scene in self.scenes}
        self.failed = {ref["key"]: self._failure(ref["key"]) for ref in refs}
        self.written, self.due = 0, clock() + FIRST_SECONDS
        self._take_complete()  # those of an earlier run are no news

    def advance(self, task: str, done: int, total: int) -> None:
        """Pass on; when cells are counted, look which scenes have become complete."""
        super().advance(task, done, total)
        if task == "cells":
            self._look()

    @property
    def complete(self) -> list[str]:
        """The complete scenes, in the order of the run."""
        return [scene for scene in self.scenes if scene not in self.open]

    def _look(self) -> None:
        for scene in self._take_complete():
            self.say(f"{scene}: complete, {self._share()}")
        if self.open and len(self.complete) > self.written and self.clock() >= self.due:
            began = self.clock()
            self._write()
            ended = self.clock()
            self.due = ended + PAUSE * (ended - began)

    def _share(self) -> str:
        return f"{len(self.complete)} of {len(self.scenes)} scenes"

    def _take_complete(self) -> list[str]:
        found = [scene for scene, keys in self.open.items() if all(map(self._has_ended, keys))]
        for scene in found:
            del self.open[scene]
        return found

    def _has_ended(self, key: str) -> bool:
        return self.store.has_result(key) or self._failure(key) != self.failed[key]

    def _failure(self, key: str) -> Failure | None:
        with suppress(StoreError):  # whatever needs the file says what is wrong with it
            return self.store.failure(key)
        return None

    def _write(self) -> None:
        """Have the reports over the complete scenes written; an error is shown, and the next scene tries again."""
        self.written = len(self.complete)
        try:
            lines = self.report(self.complete).splitlines()
        except StoreError as error:
            self.say(f"the reports over {self._share()} were not written, and the run goes on: {error.what}")
            return
        if self.table:
            for line in lines:
                self.say(line)
            page = self.store.folder / "report.html"
            self.say(f"This is the first table, over {self._share()}. While the run goes on, {page} grows with it.")
            self.table = False


def reported(folder: Path, scenes: Sequence[str], width: int | None) -> str:
    """Write the reports over some scenes of the run in ``folder``; returns their table. Raises StoreError."""
    order = {"folder": str(folder), "scenes": list(scenes), "width": width}
    try:
        done = subprocess.run(
            [*CHILD, "report"],
            input=json.dumps(order),
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
            timeout=LONGEST_SECONDS,
            start_new_session=True,  # Ctrl-C asks the run to stop, which lets this end
        )
    except OSError as error:
        raise StoreError(f"reports could not be begun: {error.strerror}") from error
    except subprocess.TimeoutExpired as error:
        raise StoreError(f"reports took more than {LONGEST_SECONDS:.0f} s and were ended") from error
    if done.returncode:
        said = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
        raise StoreError(said[0].removeprefix("error: ") if said else f"reports ended with code {done.returncode}")
    return done.stdout


def growing(plan: RunPlan, store: Store, progress: Progress, table: bool) -> Progress:
    """The progress of a run with growing reports; unchanged for a single scene or one part of several."""
    parts = plan.spec.shard[1]
    if parts > 1 or len(plan.scenes) == 1:
        return progress
    width = shutil.get_terminal_size().columns if sys.stderr.isatty() else None
    report = partial(reported, store.folder, width=width)
    return GrowingReports(progress, store, [ref for ref, _ in plan.cells], report, table)
