"""A command of a run, from its first attempt to the record of its good end."""

import os
import re
import shutil
import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from radiogs_core.errors import ExplainedError

from .errors import CommandFailed
from .family import LIMITS
from .place import Place
from .process import Ended, Order, Running
from .records import (
    Listing,
    Record,
    digest_of,
    read_json,
    read_record,
    write_json,
)

LAST_LINES = 12
"""Lines of a log that stand in the message of a failure."""

NO_SPACE = re.compile(r"no space left|disk quota exceeded|file too large|errno 28\b|errno 122\b", re.IGNORECASE)
LITTLE_SPACE = 2**20


@dataclass(frozen=True)
class Task:
    """One command and what it must leave behind.

    ``order`` is a digest of what is run. ``arguments`` gives them filled in, told whether it goes on with a run that
    was cut short. ``wrote`` lists what it has written, relative to the workspace, and raises for what is missing;
    ``inspect`` looks into those files, once. ``before`` makes ready what the command reads.
    """

    place: Place
    name: str
    order: str
    arguments: Callable[[bool], Sequence[str]]
    wrote: Callable[[], Listing]
    light: str = ""
    time_limit: float | None = None
    resumes: bool = False
    before: Callable[[], None] = lambda: None
    inspect: Callable[[], None] = lambda: None

    def done(self) -> Record | None:
        """The record of its good end, if what it wrote is still there and the same."""
        record = read_record(self.place.done(self.name))
        if record is None or record.order != self.order:
            return None
        try:
            return record if digest_of(self.wrote()) == record.files else None
        except ExplainedError:
            return None

    def begin(self) -> "Attempt":
        """Start it: in a clean folder, or in the folder as it is where it resumes."""
        place = self.place
        place.make(place.output)
        values = place.values(self.light)
        folder = place.working_folder(values)
        resuming = self._prepare_folder()
        self.before()
        order = Order(
            self.arguments(resuming),
            folder,
            place.environment(values),
            place.log(self.name),
            place.root,
            self.time_limit,
        )
        return Attempt(self, Running(order))

    def _prepare_folder(self) -> bool:
        """Whether it goes on: there is an attempt that was cut short, something came of it, and the code can."""
        place = self.place
        place.done(self.name).unlink(missing_ok=True)
        there = files_in(place.output)
        before = read_json(place.begun(self.name))
        if not isinstance(before, list):
            write_json(place.begun(self.name), sorted(file.relative_to(place.output).as_posix() for file in there))
            return False
        known = {place.output / name for name in before}
        left = [file for file in there if file not in known]
        if self.resumes and left:
            return True
        for file in left:
            file.unlink(missing_ok=True)
        return False


class Attempt:
    """A task that is running."""

    def __init__(self, task: Task, running: Running) -> None:
        self.task, self._running = task, running

    def poll(self, seconds: float) -> Record | None:
        """Wait at most so long; returns the record of its good end, None while it runs. Raises CommandFailed."""
        ended = self._running.poll(seconds)
        if ended is None:
            return None
        if ended.too_long or ended.exit_code != 0 or ended.survivors:
            raise self._failed(*_how(ended, self.task.time_limit))
        try:
            listing = self.task.wrote()
            self.task.inspect()
        except ExplainedError as error:
            raise self._failed("ended well, but not all that it should have written is there", str(error)) from error
        return self._recorded(ended, listing)

    def end(self) -> None:
        """End it with all its children, if it runs."""
        self._running.end()

    def _recorded(self, ended: Ended, listing: Listing) -> Record:
        task, place = self.task, self.task.place
        record = Record(
            command=task.name,
            order=task.order,
            output=place.output.relative_to(place.root).as_posix(),
            log=place.log(task.name).relative_to(place.root).as_posix(),
            files=digest_of(listing),
            file_count=len(listing),
            file_bytes=sum(listing.values()),
            exit_code=ended.exit_code,
            seconds=ended.seconds,
            peak_bytes=ended.peak_bytes,
        )
        write_json(place.done(task.name), record.plain())
        return record

    def _failed(self, how: str, why: str = "") -> CommandFailed:
        task, log = self.task, self._running.log
        last = log.last_lines(LAST_LINES)
        full = _full_disk(task.place.root, last + log.trouble + why)
        parts = [why, full, log.trouble, f"The last it said:\n{last}" if last else "It said nothing.", LIMITS]
        again = "it goes on where it was" if task.resumes else "this command begins again, those before it are kept"
        return CommandFailed(
            f"{task.place.file.title}: the command '{task.name}' {how}",
            "\n".join(part for part in parts if part),
            f"All it said: {log.path}\n" + ("Make room and run" if full else "Run") + f" the same again: {again}.",
        )


def files_in(folder: Path) -> list[Path]:
    """All files below a folder; links are files of their own and are not followed."""
    return [Path(parent) / name for parent, _, names in os.walk(folder) for name in names]


def _how(ended: Ended, limit: float | None) -> tuple[str, str]:
    if ended.survivors:
        numbers = ", ".join(map(str, ended.survivors))
        return "left processes that cannot be ended", f"They hang in the system: {numbers}. End them before all else."
    if ended.too_long:
        return f"was ended after {limit:g} seconds, its time limit", "The method's file sets it (time_limit)."
    if ended.exit_code > 0:
        return f"ended with exit code {ended.exit_code}", ""
    number = -ended.exit_code
    name = next((each.name for each in signal.Signals if each == number), str(number))  # real-time ones have none
    why = "The system does that where memory runs out." if name == "SIGKILL" else ""
    return f"was ended by the signal {name}", why


def _full_disk(folder: Path, said: str) -> str:
    free = shutil.disk_usage(folder).free
    if free < LITTLE_SPACE or NO_SPACE.search(said):
        return f"The disk seems to be full: {folder} has {free / 2**20:.1f} MiB left."
    return ""
