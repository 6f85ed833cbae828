"""A published code, run as commands, is a row beside other methods: scored, resumed, stopped, and failing alone."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from baselines.commands.bench import toml
from public_outputs import WRITERS, noisy
from radiogs_bench.cli import main
from radiogs_datasets import load_scene

LAYOUTS = ("radiogs", "gs-ir", "tensoir")
RUN = ("run", "synthetic4relight", "--preset", "smoke", "--scenes", "convex", "--protocol", "default")
"""A suite of one row."""

STAND_IN = Path(__file__).parents[2] / "baselines" / "commands"


@pytest.fixture(scope="module")
def shelf(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """A folder with results in a code's layout, which the stand-in lays out as if it had made them."""
    root, predicted = tmp_path_factory.mktemp("shelf"), noisy(load_scene("convex"))
    for layout in LAYOUTS:
        WRITERS[layout](root / layout, predicted)
    return lambda layout: root / layout


@pytest.fixture(autouse=True)
def _stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STAND_IN_HOME", str(STAND_IN))
    monkeypatch.setenv("STAND_IN_PYTHON", sys.executable)


def written(folder: Path, shelf: Path, layout: str, habit: str = "", head: str = "") -> Path:
    """A method's file whose first command has a habit of the stand-in's."""
    pantry = f"--pantry|{shelf}"
    first = "--name|model-1" + (f"|--habit|{habit}" if habit else "")
    text = toml([first, "--name|model-2"], pantry, f"{pantry}|--light|{{light}}", layout, head)
    path = folder / f"{layout}.toml"
    path.write_text(text.replace('name = "stand-in"', f'name = "{layout}-stand-in"', 1))
    return path


def results(out: Path) -> dict[str, dict[str, Any]]:
    """Finished results by method."""
    found = [json.loads(path.read_text()) for path in (out / "cells").glob("*.json") if "failed" not in path.name]
    return {result["cell"]["method"]: result for result in found}


def run(out: Path, *arguments: str) -> int:
    return main([*RUN, "--out", str(out), *arguments])


@pytest.mark.slow
@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_metric_equals_the_score_of_the_folder(
    layout: str, shelf: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert run(out, "--method", f"{written(tmp_path, shelf(layout), layout)}") == 0
    result = results(out)[f"{layout}-stand-in"]
    capsys.readouterr()
    scored = tmp_path / "scored.json"
    assert main(["score", f"{shelf(layout)}", "--scene", "convex", "--from", layout, "--out", f"{scored}"]) == 0
    other = json.loads(scored.read_text())["protocols"]["default"]
    for name, metric in result["metrics"].items():
        if metric["value"] is not None and not name.endswith("/constant"):  # a property of the scene, of no folder
            assert metric["value"] == pytest.approx(other["metrics"][name]["value"], abs=1e-9), name
    assert result["metrics"]["nvs/psnr"]["value"] is not None
    assert [stage["name"] for stage in result["stages"]] == ["stage-1", "stage-2"]
    assert result["seconds"]["stage-1"] > 0
    assert "nvs/ms" not in result["timings"]  # reading a file is no rendering
    assert result["facts"]["commands"]


@pytest.mark.slow
def test_a_crashing_cell_fails_alone_and_once_repaired_stands_beside_radiogs_and_is_not_run_twice(
    shelf: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, note = tmp_path / "out", tmp_path / "note"
    path = written(tmp_path, shelf("gs-ir"), "gs-ir", habit="crash")
    assert run(out, "--method", f"{path},radiogs") == 1
    assert set(results(out)) == {"radiogs"}
    assert len(results(out)["radiogs"]["metrics"]) > 5
    said = capsys.readouterr().err
    assert "stage-1" in said
    assert "exit code 1" in said
    written(tmp_path, shelf("gs-ir"), "gs-ir")
    path.write_text(path.read_text().replace('"--name", "model-1"', f'"--name", "model-1", "--note", "{note}"'))
    for _ in range(2):
        assert run(out, "--method", f"{path},radiogs") == 0
        assert set(results(out)) == {"radiogs", "gs-ir-stand-in"}
    assert note.read_text().count("train") == 1
    assert "Stand-in" in (out / "synthetic4relight.md").read_text()


@pytest.mark.slow
def test_ctrl_c_stops_the_command_and_its_children_and_the_run_goes_on_later(
    shelf: Callable[[str], Path], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    path = written(tmp_path, shelf("gs-ir"), "gs-ir", habit="hang")
    command = [sys.executable, "-m", "radiogs_bench", *RUN, "--out", f"{out}", "--method", f"{path}"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    going = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, env=environment)
    deadline = time.monotonic() + 120
    while not (logs := list(out.glob("work/*/logs/*.log"))) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert logs
    hanging = [pid for pid in _processes() if str(out) in _command_line(pid) and pid != going.pid]
    assert hanging
    going.send_signal(signal.SIGINT)
    _, said = going.communicate(timeout=60)
    assert going.returncode == 130, said
    assert not [pid for pid in hanging if str(out) in _command_line(pid)]
    assert results(out) == {}
    path.write_text(path.read_text().replace('"--habit", "hang"', '"--habit", ""'))
    assert run(out, "--method", f"{path}") == 0
    assert set(results(out)) == {"gs-ir-stand-in"}


def _processes() -> list[int]:
    return [int(each.name) for each in Path("/proc").iterdir() if each.name.isdecimal()]


def _command_line(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
    except OSError:
        return ""
