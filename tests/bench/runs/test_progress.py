"""Progress is bars on a terminal and lines in a log; what is missing is forecast from finished cells like it."""

import io
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from bench.fake_method import CPU, SCENE, FakeSweep, asked, fake_cell
from radiogs.settings import PRESETS, Variant
from radiogs_bench.cli.plan import needs, show_plan, whole_memory, whole_time
from radiogs_bench.durations import duration, time_left
from radiogs_bench.runs.forecast import Expected, forecast, total
from radiogs_bench.runs.progress import LogProgress, SweepProgress, TerminalProgress, progress_for_stderr
from radiogs_bench.store.folder import Store, product_name
from radiogs_bench.store.seal import sealed, strict_json
from radiogs_core.kernels.runtime import workers
from radiogs_reports.analysis.power import Planned
from radiogs_reports.statistics import Level


def test_a_pipe_gets_lines_and_nothing_that_moves(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_for_stderr() as progress:
        progress.say("corner ours seed 0: started")
        for step in range(1000):
            progress.advance("init", step + 1, 1000)
    assert isinstance(progress, LogProgress)
    assert capsys.readouterr() == ("", "corner ours seed 0: started\n")


def test_a_log_has_a_line_per_minute_for_longer_work(capsys: pytest.CaptureFixture[str]) -> None:
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


def test_a_finished_bar_disappears_and_a_resumed_one_starts_at_its_step(screen: Screen) -> None:
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


def test_the_sweep_counts_steps_of_all_stages_except_checkpointed_ones() -> None:
    recorder = Recorder()
    with SweepProgress(recorder, ("one", "two"), steps=40) as progress:
        for step in range(1, 11):
            progress.advance("ball ours seed 0: one", step, 10)
        assert recorder.last["all stages"] == (10, 40)
        for step in range(15, 21):  # continued from a checkpoint at step 14
            progress.advance("two", step, 20)
        progress.advance("evaluation", 3, 8)
        assert recorder.last["all stages"] == (16, 26)
        for step in range(1, 11):  # the next cell's
            progress.advance("one", step, 10)
    first = {"ball ours seed 0: one": (10, 10), "one": (10, 10)}
    assert recorder.last == {**first, "two": (20, 20), "evaluation": (3, 8), "all stages": (26, 26)}


def test_a_bar_that_gets_no_steps_for_a_while_is_shown_all_the_same(screen: Screen) -> None:
    screen.progress.advance("cells", 0, 10)
    screen.clock = 5.0
    (line,) = screen.drawn()
    assert line.startswith("cells")
    screen.progress.advance("invert", 1, 10)
    assert len(screen.drawn()) == 1


@pytest.mark.parametrize(
    ("seconds", "said"), [(0.4, "0 s"), (99.0, "99 s"), (150.0, "2 min"), (5400.0, "90 min"), (11100.0, "3 h 05 min")]
)
def test_time_left_is_printed_in_suitable_units(seconds: float, said: str) -> None:
    assert time_left(seconds) == said


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(0.04, "0.0 s"), (119.0, "119.0 s"), (120.0, "2.0 min"), (9000.0, "2.5 h"), (200_000.0, "2.3 days")],
)
def test_durations_are_printed_in_suitable_units(seconds: float, said: str) -> None:
    assert duration(seconds) == said


CELLS = [cell for _, cell in asked(2).cells]
SECONDS = {"initialise": 100.0, "invert": 10.0, "evaluate": 1.0}


def measured(store: Store, key: str, seconds: dict[str, float], held: dict[str, int]) -> None:
    """Write other figures of cost into a stored result, whose arrays stay."""
    result: Any = store.result(key)
    result["seconds"] = seconds
    for sessions in result["sessions"].values():
        for session in sessions:
            session["peak_memory_bytes"] = held
    store.take_over({f"cells/{key}.json": strict_json(sealed(result))})


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """Holds the whole first seed; rows took SECONDS, but the last one ten times as long."""
    sweep = FakeSweep(tmp_path)
    sweep.run(CELLS[:5])
    for cell in CELLS[:4]:
        measured(sweep.store, cell.key, SECONDS, {"host": 2**30})
    slow = {stage: 10 * seconds for stage, seconds in SECONDS.items()}
    measured(sweep.store, CELLS[4].key, slow, {"host": 2**31, "device": 2**29})
    return sweep.store


def test_a_rows_forecast_is_its_own_time_and_shared_stages_count_once(store: Store) -> None:
    expected = forecast(store, CELLS)
    assert expected[:5] == [None] * 5
    assert expected[5:] == [
        Expected(111.0, 2**30, None),
        *[Expected(11.0, 2**30, None)] * 3,  # stage 1 comes with the first
        Expected(1110.0, 2**31, 2**29),
    ]
    assert total(expected) == (pytest.approx(111 + 3 * 11 + 1110), 0)
    assert whole_time(expected) == "about 20.9 min"
    assert whole_memory(expected) == "up to 2.00 GiB, GPU 0.50 GiB"


def test_several_at_a_time_share_the_work_until_the_longest_cell_decides() -> None:
    cells = [None, *[Expected(100.0, None, None)] * 6]
    assert whole_time(cells) == "about 10.0 min"
    assert whole_time(cells, 2) == "about 5.0 min"
    assert whole_time([*cells, Expected(1000.0, None, None)], 4) == "about 16.7 min"


def test_a_plan_prints_the_time_of_workers_and_the_measured_threads(
    store: Store, capsys: pytest.CaptureFixture[str]
) -> None:
    request = asked(3)
    measured_on = workers(CPU)
    show_plan(request, store, 2, measured_on + 1, {})
    said = capsys.readouterr().out
    assert "10 of 15 cells to run" in said
    note = f"measured on {measured_on} threads a cell; here a cell has {measured_on + 1}"
    assert f"time, one after the other: about 41.8 min ({note})" in said  # twice 111 + 3 * 11 + 1110 seconds
    assert "time, 2 at a time: about 20.9 min\n" in said
    show_plan(request, store, 1, measured_on, {})
    said = capsys.readouterr().out
    assert "about 41.8 min\n" in said
    assert "at a time" not in said


def test_stored_stages_take_no_time_in_a_forecast(store: Store) -> None:
    for stage in CELLS[5].stages:
        store.put_tensors(product_name(stage.key), {})
    assert forecast(store, CELLS[5:6]) == [Expected(1.0, 2**30, None)]


def test_a_row_that_never_ran_is_forecast_from_other_rows(store: Store) -> None:
    new = fake_cell(seed=7, variant=Variant(radiometric_weight=0.5))
    (expected,) = forecast(store, [new])
    assert expected.seconds == pytest.approx((4 * 111 + 1110) / 5)


def test_another_scene_is_forecast_from_this_one(store: Store) -> None:
    assert forecast(store, [fake_cell(seed=7, scene=replace(SCENE, checksum="1" * 64))]) == [
        Expected(111.0, 2**30, None)
    ]


@pytest.mark.parametrize("change", [{"budget": PRESETS["tiny"]}, {"device": "cuda"}, {"experiment": "forward-parity"}])
def test_a_forecast_of_unlike_work_is_unknown(change: dict[str, Any], store: Store) -> None:
    expected = forecast(store, [fake_cell(**change)])
    assert expected == [Expected(None, None, None)]
    assert total(expected) == (0.0, 1)
    assert whole_time(expected).startswith("unknown")
    assert whole_memory(expected) == "unknown"


@pytest.mark.parametrize(
    ("needed", "said"),
    [
        (
            {"scenes": 9, "seeds": 4},
            "9 scenes of each kind, with as many seeds as now, or 4 seeds on as many scenes as now.",
        ),
        ({"kinds": 7}, "7 kinds of scenes, each with as many scenes and seeds as now."),
        ({}, "neither scenes nor seeds that the stored spread tells of."),
    ],
)
def test_the_scenes_and_seeds_that_a_difference_needs_are_printed(needed: dict[Level, int], said: str) -> None:
    column = {"key": "nvs/psnr", "label": "NVS PSNR", "unit": "dB", "direction": "up", "decimals": 2}
    found = needs(Planned(column, 0.4, 0.25, needed))  # type: ignore[arg-type]
    assert found == f"To resolve 0.25 dB of NVS PSNR in four of five runs: {said}"
