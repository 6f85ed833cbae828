"""Progress: bars with time left on a terminal; in a log one line per cell, and one per minute for longer work."""

import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from typing import Protocol, Self

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderableType
from rich.measure import Measurement
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    ProgressColumn,
    Task,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as RichProgress
from rich.segment import Segment
from rich.table import Column, Table
from rich.text import Text

from ..durations import time_left
from ..errors import visible

LOGGED_EVERY_SECONDS = 60.0
"""Between two lines about steps in a log."""


class Progress(Protocol):
    """Receives the events of a run."""

    def __enter__(self) -> Self:
        """Start showing."""
        return self

    def __exit__(self, *error: object) -> None:
        """Stop showing."""

    def say(self, line: str) -> None:
        """Show one line: a cell started, finished, failed."""

    def advance(self, task: str, done: int, total: int) -> None:
        """Report that ``task`` is at ``done`` of ``total`` steps; it ends when they are equal."""


class TextConsole(Console):
    """A console that escapes control characters in texts; only the console itself colours."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """As in rich, with ``visible`` texts."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(visible(segment.text), segment.style)


class TerminalProgress(Progress):
    """A bar with time left for each running task, below the printed lines."""

    def __init__(self) -> None:
        self.bars = bars_on(TextConsole(stderr=True))
        self.tasks: dict[str, TaskID] = {}

    def __enter__(self) -> Self:
        self.bars.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.bars.stop()

    def say(self, line: str) -> None:
        """Print a line above the bars."""
        self.bars.console.print(line, markup=False, highlight=False)

    def advance(self, task: str, done: int, total: int) -> None:
        """Move a bar; it is drawn once its task has taken two seconds, and disappears when the task ends."""
        if task not in self.tasks:
            # Begun at the first report: a resumed task's time left must not count steps of another process.
            self.tasks[task] = self.bars.add_task(task, total=total, completed=done)
        self.bars.update(self.tasks[task], completed=done, total=total)
        if done >= total:
            self.bars.remove_task(self.tasks.pop(task))


class LogProgress(Progress):
    """Lines to stderr: messages, and every LOGGED_EVERY_SECONDS the progress of the task that reports then."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.clock = clock
        self.due = clock() + LOGGED_EVERY_SECONDS
        self.begun: dict[str, tuple[int, float]] = {}

    def __exit__(self, *error: object) -> None:
        sys.stderr.flush()

    def say(self, line: str) -> None:
        """Print a line."""
        sys.stderr.write(visible(line) + "\n")

    def advance(self, task: str, done: int, total: int) -> None:
        """Write a line if one is due."""
        now = self.clock()
        at, since = self.begun.setdefault(task, (done, now))
        if done >= total:
            del self.begun[task]
        elif now >= self.due and done > at:
            left = time_left((now - since) / (done - at) * (total - done))
            self.say(f"{task}: {done:,} of {total:,}, about {left} left")
            self.due = now + LOGGED_EVERY_SECONDS


class ForwardingProgress(Progress):
    """Passes every event on to another ``Progress``; subclasses override what they add to."""

    def __init__(self, progress: Progress) -> None:
        self.progress = progress

    def __enter__(self) -> Self:
        self.progress.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self.progress.__exit__(*error)

    def say(self, line: str) -> None:
        """Pass the line on."""
        self.progress.say(line)

    def advance(self, task: str, done: int, total: int) -> None:
        """Pass the steps on."""
        self.progress.advance(task, done, total)


class SweepProgress(ForwardingProgress):
    """Forwards everything, and adds a task for the steps of all stages: cells are too few to estimate time left."""

    def __init__(self, progress: Progress, stages: Collection[str], steps: int) -> None:
        super().__init__(progress)
        self.stages, self.steps = tuple(stages), steps
        self.taken = 0
        self.stands: dict[str, int] = {}

    def advance(self, task: str, done: int, total: int) -> None:
        """Pass on, and count the step if it belongs to a stage."""
        if task.endswith(self.stages):  # after the name of its cell
            before = self.stands.get(task)
            if before is None:  # what a checkpoint brought was not taken here, and says nothing about the speed
                self.steps -= done - 1
                before = done - 1
            self.taken += done - before
            self.stands[task] = done
            if done >= total:
                del self.stands[task]
            self.progress.advance("all stages", self.taken, self.steps)
        super().advance(task, done, total)


@contextmanager
def working(task: str) -> Iterator[None]:
    """Shows work that reports no steps, with the time it has taken."""
    with progress_for_stderr() as progress:
        progress.advance(task, 0, 1)
        yield


def progress_for_stderr() -> Progress:
    """Bars if stderr is a terminal, lines otherwise."""
    return TerminalProgress() if sys.stderr.isatty() else LogProgress()


SHOWN_AFTER_SECONDS = 2.0
"""Tasks shorter than this show no bar."""

SPEED_WINDOW_SECONDS = 3600.0
"""Period over which speed is averaged for the time left; rich's default of 30 s is less than one cell takes."""

BAR_WIDTH = 12
SHORTEST_NAME = 8
"""Characters of a task's name that are kept on the narrowest terminal."""


def bars_on(console: Console) -> RichProgress:
    """A bar for each task: name, bar, steps, time taken, time left. Only the name gives way on a narrow terminal."""
    return _Bars(
        _Name(table_column=Column()),
        BarColumn(BAR_WIDTH, table_column=_whole()),
        MofNCompleteColumn(table_column=_whole()),
        TimeElapsedColumn(table_column=_whole()),
        TextColumn("left", table_column=_whole()),
        TimeRemainingColumn(table_column=_whole()),
        console=console,
        speed_estimate_period=SPEED_WINDOW_SECONDS,
        transient=True,
    )


def _whole() -> Column:
    """A column that is never narrower than its content."""
    return Column(no_wrap=True)


class _Bars(RichProgress):
    """Draws only tasks that have taken longer than SHOWN_AFTER_SECONDS, even if they report nothing meanwhile."""

    def make_tasks_table(self, tasks: Iterable[Task]) -> Table:
        return super().make_tasks_table([task for task in tasks if (task.elapsed or 0.0) > SHOWN_AFTER_SECONDS])


class _Name(ProgressColumn):
    """The name of a task on one line."""

    def render(self, task: Task) -> "FittingWords":
        return FittingWords(task.description)


class FittingWords:
    """As many of a text's words as fit on a line, then an ellipsis: no word or number is cut."""

    def __init__(self, text: str) -> None:
        self.text = text

    def within(self, width: int) -> str:
        """The text in at most ``width`` characters; a first word that is longer is cut."""
        if cell_len(self.text) <= width:
            return self.text
        words = self.text.split(" ")
        while len(words) > 1 and cell_len(" ".join(words)) + 2 > width:
            words.pop()
        return f"{' '.join(words)} …"

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Text]:
        yield Text(self.within(options.max_width), no_wrap=True, overflow="ellipsis")

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        return Measurement(min(SHORTEST_NAME, cell_len(self.text)), cell_len(self.text))
