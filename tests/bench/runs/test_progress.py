"""Progress is bars on a terminal, lines in a log, and keeps off stdout in both."""

import io
import sys

import pytest
from rich.console import Console

from radiogs_bench.runs.progress import LogProgress, SweepProgress, TerminalProgress, progress_for_stderr


def test_a_pipe_gets_lines_and_nothing_that_moves(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_for_stderr() as progress:
        progress.say("corner ours seed 0: started")
        for step in range(1000):
            progress.advance("init", step + 1, 1000)
    assert isinstance(progress, LogProgress)
    assert capsys.readouterr() == ("", "corner ours seed 0: started\n")


def test_a_log_has_a_line_a_minute_of_what_takes_longer(capsys: pytest.CaptureFixture[str]) -> None:
    now = 0.0
    progress = LogProgress(lambda: now)
    for step in range(100):
        progress.advance("all stages", step, 1000)
        progress.advance("stage 2, inverse rendering", step, 100)
        now += 1.5
    assert capsys.readouterr().err.splitlines() == [
        "all stages: 40 of 1,000, about 24 min left",
        "all stages: 80 of 1,000, about 23 min left",
    ]
    progress.advance("stage 2, inverse rendering", 100, 100)
    progress.advance("stage 2, inverse rendering", 5, 10)  # of another cell: nothing is known of its speed
    now += 100
    progress.advance("stage 2, inverse rendering", 6, 10)
    assert capsys.readouterr().err == "stage 2, inverse rendering: 6 of 10, about 7 min left\n"


def test_a_terminal_gets_bars(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    assert isinstance(progress_for_stderr(), TerminalProgress)


class Screen:
    """A terminal in memory, ``width`` characters wide, whose clock the test turns."""

    def __init__(self, width: int = 120) -> None:
        self.progress, self.clock = TerminalProgress(), 0.0
        self.progress.bars.get_time = lambda: self.clock
        self.console = Console(file=io.StringIO(), force_terminal=True, width=width, color_system=None)

    def drawn(self) -> list[str]:
        """The lines of the bars, as they are drawn now."""
        with self.console.capture() as captured:
            self.console.print(self.progress.bars.get_renderable())
        return [line for line in captured.get().splitlines() if line.strip()]


@pytest.fixture
def screen() -> Screen:
    return Screen()


def test_a_bar_shows_time_left_once_it_has_run_for_two_seconds(screen: Screen) -> None:
    advance = screen.progress.advance
    advance("invert", 3, 10)  # begun here: what another process did says nothing about the speed of this one
    screen.clock = 1.0
    advance("invert", 4, 10)
    assert screen.drawn() == []
    screen.clock = 7.0
    advance("invert", 7, 10)
    (line,) = screen.drawn()
    assert line.split()[0] == "invert"
    assert line.split()[2:] == ["7/10", "0:00:07", "left", "0:00:06"]  # 3 steps took 6 s, 3 are left


@pytest.mark.parametrize("width", [80, 60])
def test_on_a_narrow_terminal_a_name_loses_words_and_no_number_a_digit(width: int) -> None:
    screen = Screen(width)
    screen.progress.advance("corner nvs-init seed 12: stage 1, initialisation", 11_000, 20_000)
    screen.progress.advance("all stages", 4, 100_000)
    screen.clock = 7200.0
    screen.progress.advance("corner nvs-init seed 12: stage 1, initialisation", 12_000, 20_000)
    first, second = screen.drawn()
    name = first.split("━")[0].strip()
    assert name.endswith(" …")
    assert "corner nvs-init seed 12: stage 1, initialisation".startswith(name.removesuffix("…"))
    for line, whole in ((first, "12000/20000 2:00:00 left"), (second, "4/100000 2:00:00 left")):
        assert whole in " ".join(line.split())
        assert len(line) <= width


def test_a_finished_bar_goes_and_a_resumed_one_starts_where_it_stands(screen: Screen) -> None:
    screen.progress.advance("init", 9, 10)
    assert screen.progress.bars.tasks[0].completed == 9
    screen.progress.advance("init", 10, 10)
    assert screen.progress.bars.tasks == []


class Recorder(LogProgress):
    """Remembers the last report of each task."""

    def __init__(self) -> None:
        self.last: dict[str, tuple[int, int]] = {}

    def advance(self, task: str, done: int, total: int) -> None:
        self.last[task] = (done, total)


def test_the_sweep_counts_the_steps_of_all_stages_and_not_those_of_a_checkpoint() -> None:
    recorder = Recorder()
    with SweepProgress(recorder, ("one", "two"), steps=40) as progress:
        for step in range(1, 11):
            progress.advance("one", step, 10)
        assert recorder.last["all stages"] == (10, 40)
        for step in range(15, 21):  # continued from a checkpoint at step 14
            progress.advance("two", step, 20)
        progress.advance("evaluation", 3, 8)
        assert recorder.last["all stages"] == (16, 26)
        for step in range(1, 11):  # the next cell's
            progress.advance("one", step, 10)
    assert recorder.last == {"one": (10, 10), "two": (20, 20), "evaluation": (3, 8), "all stages": (26, 26)}


def test_a_bar_that_gets_no_steps_for_a_while_is_shown_all_the_same(screen: Screen) -> None:
    screen.progress.advance("cells", 0, 10)
    screen.clock = 5.0
    (line,) = screen.drawn()
    assert line.startswith("cells")
    screen.progress.advance("invert", 1, 10)
    assert len(screen.drawn()) == 1
