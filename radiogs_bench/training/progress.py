"""What a run shows of itself: bars with time left on a terminal, one line a cell in a log."""

import sys
from collections.abc import Collection
from types import TracebackType
from typing import Protocol, runtime_checkable

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bars

SHOWN_AFTER_SECONDS = 2.0
"""What takes less is over before it can be read."""

SPEED_WINDOW_SECONDS = 3600.0
"""Steps that time left is judged by; rich's half a minute is less than one cell takes."""


@runtime_checkable
class Progress(Protocol):
    """Receives what happens during a run."""

    def __enter__(self) -> "Progress":
        """Begin to show."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End showing."""

    def say(self, line: str) -> None:
        """One event worth a line: a cell started, finished, failed."""

    def advance(self, task: str, done: int, total: int) -> None:
        """``task`` stands at ``done`` of ``total`` steps; it is over when they are equal."""


class TerminalProgress:
    """A bar with time left for each task in progress, below the lines that were said."""

    def __init__(self) -> None:
        self.bars = Bars(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            speed_estimate_period=SPEED_WINDOW_SECONDS,
            transient=True,
        )
        self.tasks: dict[str, TaskID] = {}

    def __enter__(self) -> "TerminalProgress":
        self.bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.bars.stop()

    def say(self, line: str) -> None:
        """Print above the bars."""
        self.bars.console.print(line, markup=False, highlight=False)

    def advance(self, task: str, done: int, total: int) -> None:
        """Move a bar; it appears once it has run for a while, and goes when it is over."""
        if task not in self.tasks:
            # Begun at the first report: a resumed task's time left must not count steps of another process.
            self.tasks[task] = self.bars.add_task(task, total=total, completed=done, visible=False)
        self.bars.update(self.tasks[task], completed=done, total=total)
        if done >= total:
            self.bars.remove_task(self.tasks.pop(task))
        for bar in self.bars.tasks:
            bar.visible = (bar.elapsed or 0.0) > SHOWN_AFTER_SECONDS


class LogProgress:
    """Lines to stderr; no bars, nothing that moves."""

    def __enter__(self) -> "LogProgress":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        sys.stderr.flush()

    def say(self, line: str) -> None:
        """One line."""
        sys.stderr.write(line + "\n")

    def advance(self, task: str, done: int, total: int) -> None:
        """Steps are too many for a log."""


class SweepProgress:
    """Passes everything on, and shows one more task: the steps of every stage that the sweep has still to take.

    Cells are too few and too unlike (four share a stage) to tell from them how much time is left.
    """

    def __init__(self, progress: Progress, stages: Collection[str], steps: int) -> None:
        self.progress, self.stages, self.steps = progress, stages, steps
        self.taken = 0
        self.stands: dict[str, int] = {}

    def __enter__(self) -> "SweepProgress":
        self.progress.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.progress.__exit__(kind, error, trace)

    def say(self, line: str) -> None:
        """Pass on."""
        self.progress.say(line)

    def advance(self, task: str, done: int, total: int) -> None:
        """Pass on, and count if it is a step of a stage."""
        if task in self.stages:
            before = self.stands.get(task)
            if before is None:  # what a checkpoint brought was not taken here, and says nothing about the speed
                self.steps -= done - 1
                before = done - 1
            self.taken += done - before
            self.stands[task] = done
            if done >= total:
                del self.stands[task]
            self.progress.advance("all stages", self.taken, self.steps)
        self.progress.advance(task, done, total)


def progress_for_stderr() -> Progress:
    """Bars if stderr is a terminal, lines otherwise."""
    return TerminalProgress() if sys.stderr.isatty() else LogProgress()
