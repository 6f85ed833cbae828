"""Progress is bars on a terminal, lines in a log, and keeps off stdout in both."""

import io
import sys

import pytest
from rich.console import Console

from radiogs_bench.training.progress import LogProgress, SweepProgress, TerminalProgress, progress_for_stderr


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


@pytest.fixture
def screen() -> TerminalProgress:
    """A terminal that writes into memory, whose clock the test turns."""
    progress = TerminalProgress()
    progress.bars.live.console = Console(file=io.StringIO(), force_terminal=True, width=120)
    return progress


def test_a_bar_shows_time_left_once_it_has_run_for_two_seconds(screen: TerminalProgress) -> None:
    clock = 0.0
    screen.bars.get_time = lambda: clock
    screen.advance("invert", 3, 10)  # begun here: what another process did says nothing about the speed of this one
    clock = 1.0
    screen.advance("invert", 4, 10)
    assert not screen.bars.tasks[0].visible
    clock = 7.0
    screen.advance("invert", 7, 10)
    (bar,) = screen.bars.tasks
    assert bar.visible
    assert bar.time_remaining == pytest.approx(6.0)  # 3 steps took 6 s, 3 are left


def test_a_finished_bar_goes_and_a_resumed_one_starts_where_it_stands(screen: TerminalProgress) -> None:
    screen.advance("init", 9, 10)
    assert screen.bars.tasks[0].completed == 9
    screen.advance("init", 10, 10)
    assert screen.bars.tasks == []


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


def test_a_bar_that_gets_no_steps_for_a_while_is_shown_all_the_same(screen: TerminalProgress) -> None:
    clock = 0.0
    screen.bars.get_time = lambda: clock
    screen.advance("cells", 0, 10)
    clock = 5.0
    screen.advance("invert", 1, 10)
    assert [bar.visible for bar in screen.bars.tasks] == [True, False]
