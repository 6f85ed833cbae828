"""``status`` of a folder that ``train`` fills: its step and the time left, and that it has ended."""

import json
import time
from pathlib import Path

import pytest

from radiogs_bench.cli import main
from radiogs_bench.runs import stored_progress
from radiogs_bench.store.folder import Store
from radiogs_bench.store.pace import Pace, drop_pace, pace_of, put_pace

KEY = "0123abcd"


def pace(done: int = 466, speed: float | None = 0.5) -> Pace:
    return Pace("stage 2, inverse rendering", done, 3000, speed, time.time())


def test_a_line_gives_the_step_and_the_time_left(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    put_pace(Store(tmp_path), KEY, pace())
    assert main(["status", str(tmp_path)]) == 0
    assert capsys.readouterr().out == "stage 2, inverse rendering: 466 of 3,000, about 84 min left of it\n"
    assert main(["status", str(tmp_path), "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)["training"]
    assert (found["done"], found["total"]) == (466, 3000)
    put_pace(Store(tmp_path), KEY, pace(speed=None))
    assert main(["status", str(tmp_path)]) == 0
    assert capsys.readouterr().out == "stage 2, inverse rendering: 466 of 3,000\n"


def test_watch_follows_a_training_until_it_ends(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    store = Store(tmp_path)
    put_pace(store, KEY, pace(done=1))

    def goes_on(seconds: float) -> None:
        assert seconds == 7
        known = pace_of(store, KEY)
        assert known is not None
        put_pace(store, KEY, pace(done=2)) if known.done == 1 else drop_pace(store, KEY)

    monkeypatch.setattr("radiogs_bench.cli.status.time.sleep", goes_on)
    assert main(["status", str(tmp_path), "--watch", "7"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert [line.split(": ")[1].split(" ")[0] for line in said[:2]] == ["1", "2"]
    assert said[2:] == ["stopped"]


@pytest.mark.slow
def test_a_training_keeps_its_pace_while_it_works_and_status_names_its_model_afterwards(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []
    put = stored_progress.put_pace
    monkeypatch.setattr(stored_progress, "put_pace", lambda *given: seen.append(given[-1]) or put(*given))
    assert main(["train", "convex", "--preset", "smoke", "--no-score", "--out", str(tmp_path)]) == 0
    assert [each.task for each in seen if each.done == 1] == ["stage 1, initialisation", "stage 2, inverse rendering"]
    capsys.readouterr()
    assert main(["status", str(tmp_path)]) == 0
    assert capsys.readouterr().out.startswith("trained: see ")


def test_a_folder_without_a_run_or_a_model_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["status", str(tmp_path)]) == 3
    assert "no run in" in capsys.readouterr().err
