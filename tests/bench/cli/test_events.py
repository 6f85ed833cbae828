"""``--json``: all of stdout is one JSON object a line, and a reader learns of every cell whoever ran it."""

import json
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bench import fake_method
from bench.fake_method import FakeSweep, fake_cell, place_of
from radiogs_bench.cli import main
from radiogs_bench.cli.events import EventProgress
from radiogs_bench.suites.registry import SUITES
from radiogs_core.errors import NumericalFailure

Events = Callable[[], list[dict[str, Any]]]


@pytest.fixture
def events(capsys: pytest.CaptureFixture[str]) -> Events:
    def read() -> list[dict[str, Any]]:
        return [json.loads(line) for line in capsys.readouterr().out.splitlines()]

    return read


def of(kind: str, events: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [each for each in events if each["event"] == kind]


@pytest.mark.slow
def test_every_cell_is_an_event_with_its_metrics(fake_run: Callable[..., int], events: Events, tmp_path: Path) -> None:
    assert fake_run("ablations", "--json") == 0
    told = events()
    cells = of("cell", told)
    assert len({each["key"] for each in cells}) == len(cells) == 10
    for each in cells:
        stored = json.loads((tmp_path / "cells" / f"{each['key']}.json").read_text())
        assert each["state"] == "finished"
        assert each["new"]
        assert each["metrics"]["nvs/psnr"] == stored["metrics"]["nvs/psnr"]["value"]
        assert each["cell"] == f"{each['scene']} {each['row']} seed {each['seed']}"
    assert of("progress", told)[-1] == {"event": "progress", "task": "cells", "done": 10, "total": 10}
    for each in of("written", told):
        assert Path(each["path"]).is_file()
    assert told[-1] == {"event": "end", "exit_code": 0}
    assert fake_run("ablations", "--json") == 0
    assert [each["new"] for each in of("cell", events())] == [False] * 10
    assert fake_run("ablations", "--dry-run", "--json", "--difference", "nvs/psnr=0.5") == 0
    power = {each["column"]: each for each in of("power", events())}
    assert power["nvs/psnr"]["wanted"] == 0.5
    assert power["nvs/psnr"]["smallest"] == 0, "its rows differ alike with any seed"
    assert power["nvs/psnr"]["needed"] == {"seeds": 2}
    assert power["albedo/psnr"]["wanted"] is None


@pytest.mark.slow
def test_a_failed_cell_is_one_event_and_another_only_if_it_fails_again(
    fake_run: Callable[..., int], events: Events, monkeypatch: pytest.MonkeyPatch
) -> None:
    good = fake_method.evaluate

    def bad(bench: Any, cell: Any, *rest: Any) -> Any:
        if cell.seed == 1 and cell.variant.detach == "pbr":
            raise NumericalFailure("the image is not finite", "A NaN.", "Look.")
        return good(bench, cell, *rest)

    monkeypatch.setattr(fake_method, "evaluate", bad)
    assert fake_run("ablations", "--json") == 4
    told = events()
    (failed,) = [each for each in of("cell", told) if each["state"] == "failed"]
    assert (failed["row"], failed["seed"], failed["what"]) == ("detach-pbr", 1, "the image is not finite")
    assert told[-1] == {"event": "end", "exit_code": 4}
    monkeypatch.setattr(fake_method, "evaluate", good)
    assert fake_run("ablations", "--json") == 0
    assert [each["state"] for each in of("cell", events())] == ["finished"] * 10


def test_the_error_that_ends_a_run_is_the_last_event(events: Events) -> None:
    assert main(["run", "ablatoins", "--json"]) == 2
    (error,) = events()
    assert error["event"] == "error"
    assert error["exit_code"] == 2
    assert "ablations" in error["why"]


def test_ctrl_c_is_an_event_with_the_command_to_continue(
    fake_run: Callable[..., int], events: Events, monkeypatch: pytest.MonkeyPatch
) -> None:
    good = fake_method.evaluate

    def interrupted(*arguments: Any) -> Any:
        os.kill(os.getpid(), signal.SIGINT)
        return good(*arguments)

    monkeypatch.setattr(fake_method, "evaluate", interrupted)
    assert fake_run("ablations", "--json") == 130
    last = events()[-1]
    assert (last["event"], last["exit_code"]) == ("error", 130)
    assert last["remedy"] == "Run the same command again: it continues where this run stopped."


def test_steps_are_events_once_a_second_and_always_at_their_end(tmp_path: Path, events: Events) -> None:
    clock = 0.0
    progress = EventProgress(FakeSweep(tmp_path).store, [], lambda: clock)
    for step in range(1, 31):
        clock += 0.125
        progress.advance("init", step, 30)
    assert [each["done"] for each in of("progress", events())] == [1, 9, 17, 25, 30]


def test_a_cell_that_another_process_finished_is_an_event_too(tmp_path: Path, events: Events) -> None:
    sweep, cell = FakeSweep(tmp_path), fake_cell()
    with EventProgress(sweep.store, [place_of(cell)]) as progress:
        sweep.run([cell])
        progress.advance("cells", 1, 1)
    assert [each["event"] for each in events()] == ["cell", "progress"]


def test_plan_and_list_are_events(fake_run: Callable[..., int], events: Events) -> None:
    assert fake_run("ablations", "--dry-run", "--json") == 0
    planned = of("planned", events())
    assert [each["state"] for each in planned] == ["to do"] * 10
    assert {each["seconds"] for each in planned} == {None}
    assert main(["run", "--list", "--json"]) == 0
    assert [each["name"] for each in of("suite", events())] == list(SUITES)
