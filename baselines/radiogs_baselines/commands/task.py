"""A command of a run, from its first attempt to the record of its success."""

import os
import re
import shutil
import signal
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from radiogs_core.errors import ExplainedError

from .process import Command, CommandFailed, ExitStatus, Running
from .records import Listing, Record, digest_of, read_json, read_record, write_json
from .workspace import Workspace

LAST_LINES = 12
"""Number of lines of the log in the message of a failure."""

NO_SPACE = re.compile(r"no space left|disk quota exceeded|file too large|errno 28\b|errno 122\b", re.IGNORECASE)
"""Messages of a full disk."""

LITTLE_SPACE = 2**20
"""Free bytes below which a disk counts as full."""


@dataclass(frozen=True)
class Task:
    """One command and the files that it has to write."""

    workspace: Workspace
    name: str
    """Name of the command."""
    order: str
    """Digest of everything that decides the command's result."""
    arguments: Callable[[bool], Sequence[str]]
    """Returns the program and its arguments; parameter: whether it continues an interrupted run."""
    wrote: Callable[[], Listing]
    """Lists the files that the command has written; raises an error if one is missing."""
    light: str = ""
    """Name of the light that the command relights under."""
    time_limit: float | None = None
    """Longest duration in seconds; None: no limit."""
    resumes: bool = False
    """Whether the command can continue an interrupted run."""
    before: Callable[[], None] = lambda: None
    """Writes the files that the command reads."""
    inspect: Callable[[], None] = lambda: None
    """Checks the content of the files once, after the command has ended."""

    def done(self) -> Record | None:
        """The record of its success, if its files are still there and unchanged."""
        record = read_record(self.workspace.done(self.name))
        known = record is not None and record.order == self.order and record.matches(self.wrote)
        return record if known else None

    def begin(self) -> "Attempt":
        """Start the command: in a clean folder, or, if it resumes, in the folder of the interrupted run."""
        workspace = self.workspace
        workspace.make(workspace.output)
        values = workspace.values(self.light)
        folder = workspace.working_folder(values)
        resuming = self._prepare_folder()
        self.before()
        command = Command(
            self.arguments(resuming),
            folder,
            {name: text.format_map(values) for name, text in workspace.file.environment.items()},
            workspace.log(self.name),
            workspace.root,
            self.time_limit,
        )
        return Attempt(self, Running(command))

    def _prepare_folder(self) -> bool:
        """Remove the files of an interrupted run, unless the code can continue it; returns whether it continues."""
        workspace = self.workspace
        workspace.done(self.name).unlink(missing_ok=True)
        # Symbolic links count as files and are not followed.
        there = [Path(parent) / name for parent, _, names in os.walk(workspace.output) for name in names]
        before = read_json(workspace.begun(self.name))
        if not isinstance(before, list):
            write_json(
                workspace.begun(self.name), sorted(file.relative_to(workspace.output).as_posix() for file in there)
            )
            return False
        known = {workspace.output / name for name in before}
        left = [file for file in there if file not in known]
        if self.resumes and left:
            return True
        for file in left:
            file.unlink(missing_ok=True)
        return False


class Attempt:
    """A running command of a task."""

    def __init__(self, task: Task, running: Running) -> None:
        self.task, self._running = task, running

    def poll(self, seconds: float) -> Record | None:
        """Wait at most ``seconds``; returns the record of success, or None while it runs. Raises CommandFailed."""
        ended = self._running.poll(seconds)
        if ended is None:
            return None
        if ended.too_long or ended.exit_code != 0 or ended.survivors:
            raise self._failed(*_how(ended, self.task.time_limit))
        try:
            listing = self.task.wrote()
            self.task.inspect()
        except ExplainedError as error:
            raise self._failed("ended without an error, but did not write all its files", str(error)) from error
        task, workspace = self.task, self.task.workspace
        record = Record(
            command=task.name,
            order=task.order,
            output=workspace.output.relative_to(workspace.root).as_posix(),
            log=workspace.log(task.name).relative_to(workspace.root).as_posix(),
            files=digest_of(listing),
            file_count=len(listing),
            file_bytes=sum(listing.values()),
            exit_code=ended.exit_code,
            seconds=ended.seconds,
            peak_bytes=ended.peak_bytes,
        )
        write_json(workspace.done(task.name), asdict(record))
        return record

    def end(self) -> None:
        """End the command and all its children, if it is running."""
        self._running.end()

    def _failed(self, how: str, why: str = "") -> CommandFailed:
        task, log = self.task, self._running.log
        last = log.last_lines(LAST_LINES)
        root, full = task.workspace.root, ""
        if (free := shutil.disk_usage(root).free) < LITTLE_SPACE or NO_SPACE.search(last + log.trouble + why):
            full = f"The disk seems to be full: {root} has {free / 2**20:.1f} MiB left."
        parts = [why, full, log.trouble, f"Its last output:\n{last}" if last else "It printed nothing."]
        again = "it continues from its last state" if task.resumes else "it starts again, and earlier commands are kept"
        return CommandFailed(
            f"{task.workspace.file.title}: the command '{task.name}' {how}",
            "\n".join(part for part in parts if part),
            f"Its log: {log.path}\n" + ("Free disk space and run" if full else "Run") + f" the same again: {again}.",
        )


def _how(ended: ExitStatus, limit: float | None) -> tuple[str, str]:
    if ended.survivors:
        numbers = ", ".join(map(str, ended.survivors))
        return "left processes that cannot be ended", f"They wait in the kernel: {numbers}. End them first."
    if ended.too_long:
        return f"was ended after {limit:g} seconds, its time limit", "The method's file sets it (time_limit)."
    if ended.exit_code > 0:
        return f"ended with exit code {ended.exit_code}", ""
    number = -ended.exit_code
    name = next((each.name for each in signal.Signals if each == number), str(number))  # real-time ones have none
    why = "The system sends it when memory runs out." if name == "SIGKILL" else ""
    return f"was ended by the signal {name}", why
