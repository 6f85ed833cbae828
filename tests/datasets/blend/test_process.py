"""A process that ends by itself, one that complains, and a Python without Blender."""

import sys
from pathlib import Path

import pytest

from radiogs_core.errors import DataError, UsageError
from radiogs_datasets.blend import process
from radiogs_datasets.blend.process import Blender, blender_failure, require_blender
from radiogs_datasets.generate.probe import mitsuba_failure

ECHO = """
import json, os, sys
answers = os.fdopen(int(sys.argv[2]), "w")
for line in sys.stdin:
    task = json.loads(line)
    print("working on", task["task"], flush=True)
    if task["task"] == "die":
        sys.exit(11)
    wrong = {"what": "it is bent", "why": "it fell", "remedy": "Lift it."}
    answers.write(json.dumps({"error": wrong} if task["task"] == "complain" else {"done": task}) + "\\n")
    answers.flush()
"""


@pytest.fixture
def echo(monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that answers with its task; it does not need Blender."""
    monkeypatch.setattr(process, "SERVE", ECHO)
    monkeypatch.setenv(process.PYTHON_VARIABLE, sys.executable)


@pytest.mark.usefixtures("echo")
def test_tasks_are_answered_one_by_one(tmp_path: Path) -> None:
    with Blender(tmp_path / "log") as blender:
        assert blender.ask("open", file="a") == {"task": "open", "file": "a"}
        assert blender.ask("render", size=4) == {"task": "render", "size": 4}


@pytest.mark.usefixtures("echo")
def test_a_complaint_is_an_error_and_the_next_task_is_answered(tmp_path: Path) -> None:
    with Blender(tmp_path / "log") as blender:
        with pytest.raises(DataError, match=r"it is bent\nit fell\nLift it\."):
            blender.ask("complain")
        assert blender.ask("open") == {"task": "open"}


@pytest.mark.usefixtures("echo")
def test_a_process_that_ends_is_told_with_its_last_words(tmp_path: Path) -> None:
    with Blender(tmp_path / "log") as blender:
        with pytest.raises(DataError, match=r"ended by itself \(exit code 11\) at the task 'die'") as caught:
            blender.ask("die")
        assert "working on die" in str(caught.value)
        with pytest.raises(DataError, match="ended by itself"):
            blender.ask("open")


def test_a_python_without_blender_says_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(process.PYTHON_VARIABLE, str(tmp_path / "no_python"))
    with pytest.raises(UsageError, match="No such file") as caught:
        require_blender()
    assert "pip install 'radiogs-bench[blend]'" in str(caught.value)
    shadow = tmp_path / "bpy.py"
    shadow.write_text("raise ImportError('made for another Python')")
    monkeypatch.setenv(process.PYTHON_VARIABLE, sys.executable)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(UsageError, match="made for another Python"):
        require_blender()


@pytest.mark.usefixtures("echo")
def test_trials_and_blender_import_no_module_of_the_folder_where_they_are_started(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in ("bpy", "mitsuba", "json"):
        (tmp_path / f"{name}.py").write_text("from pathlib import Path\nPath(__file__).with_name('ran').touch()\n")
    monkeypatch.chdir(tmp_path)
    blender_failure()
    mitsuba_failure()
    with Blender(tmp_path / "log") as blender:
        blender.ask("open")
    assert not (tmp_path / "ran").exists()
