"""Bars with time left on a terminal, drawn so that no number is cut, however narrow it is."""

from collections.abc import Iterable, Iterator

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions
from rich.measure import Measurement
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Column, Table
from rich.text import Text

SHOWN_AFTER_SECONDS = 2.0
"""Tasks shorter than this show no bar."""

SPEED_WINDOW_SECONDS = 3600.0
"""Period over which speed is averaged for the time left; rich's default of 30 s is less than one cell takes."""

BAR_WIDTH = 12
SHORTEST_NAME = 8
"""Characters of a task's name that are kept on the narrowest terminal."""


def bars_on(console: Console) -> Progress:
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
    """A column that is never narrower than what is in it."""
    return Column(no_wrap=True)


class _Bars(Progress):
    """Draws only what has taken longer than SHOWN_AFTER_SECONDS, also where its task reports nothing meanwhile."""

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
