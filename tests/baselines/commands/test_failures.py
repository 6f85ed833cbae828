"""Codes that crash, hang, write half or fill the disk end in an error with a cause, and earlier work is kept."""

import os
import resource
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import psutil
import pytest

from baselines.commands.bench import Bench, Cells, Shelf, method_of, toml
from bench.full_disk import UNSHARE, why_nothing_can_be_mounted
from public_outputs import Maps, write_svg_ir
from radiogs_baselines.commands import process, task
from radiogs_baselines.commands.process import CommandFailed
from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.scene import Scene

FIRST, SECOND = "--name|model-1", "--name|model-2"
TREE = Path(__file__).parents[3]


@pytest.fixture(autouse=True)
def _short_grace(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(task, "Running", partial(process.Running, grace=0.3))


def lives(pid: int) -> bool:
    return psutil.pid_exists(pid) and psutil.Process(pid).status() not in (psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD)


def orphans(workspace: Path) -> list[int]:
    return [int(path.read_text()) for path in workspace.glob("orphan-*")]


def cell(cell_of: Cells, second: str, head: str = "", limit: float | None = None) -> Bench:
    """A code whose first command is sound."""
    text = toml([FIRST, second], head=head)
    if limit is not None:
        text = text.replace(
            "writes = ['{output}/model-2.pth']", f"writes = ['{{output}}/model-2.pth']\ntime_limit = {limit}"
        )
    return cell_of(text)


def mended(bench: Bench, folder: Path) -> Bench:
    """The same cell after its code was repaired; the method's file is unchanged."""
    return Bench(method_of(folder, toml([FIRST, SECOND])), bench.scene, bench.workspace, states=bench.states)


def test_a_crash_message_has_the_codes_last_lines_and_its_log(cell_of: Cells) -> None:
    bench = cell(cell_of, f"{SECOND}|--habit|crash")
    with pytest.raises(CommandFailed) as failure:
        bench.train()
    assert failure.value.what == "Stand-in: the command 'stage-2' ended with exit code 3"
    assert "an illegal memory access" in failure.value.why
    log = bench.workspace / "logs" / "stage-2.log"
    assert str(log) in failure.value.remedy
    assert "an illegal memory access" in log.read_text()
    assert [state["done"] is not None for state in bench.states] == [True, False]


def test_commands_finished_before_a_crash_do_not_run_again(tmp_path: Path, cell_of: Cells) -> None:
    """Also where the harness was killed before it had stored that the command was done."""
    note = tmp_path / "note"
    text = toml([f"{FIRST}|--note|{note}", f"{SECOND}|--note|{note}|--habit|crash after half"])
    for states in (True, False):
        bench = cell_of(text, f"work-{states}")
        note.write_text("")
        for _ in range(2):
            with pytest.raises(CommandFailed):
                bench.train()
            assert not states or len(bench.states) == 2
            bench.states = bench.states if states else []
        assert [line.count("model-1") for line in note.read_text().splitlines()] == [1, 0, 0]


def test_an_end_by_a_signal_is_named(cell_of: Cells) -> None:
    with pytest.raises(CommandFailed, match="was ended by the signal SIGKILL") as failure:
        cell(cell_of, f"{SECOND}|--habit|abort").train()
    assert "memory" in failure.value.why


@pytest.mark.parametrize("habit", ["hang tidily", "hang deaf"])
def test_a_command_that_hangs_is_ended_at_its_time_limit(habit: str, cell_of: Cells) -> None:
    bench = cell(cell_of, f"{SECOND}|--habit|{habit}", limit=1.2)
    begun = time.monotonic()
    with pytest.raises(CommandFailed, match=r"was ended after 1\.2 seconds, its time limit"):
        bench.train()
    assert time.monotonic() - begun < 10
    assert (bench.workspace / "output" / "tidied").exists() == (habit == "hang tidily")


def test_children_in_sessions_of_their_own_are_ended_with_the_command(cell_of: Cells) -> None:
    bench = cell(cell_of, f"{SECOND}|--habit|crash with orphans")
    with pytest.raises(CommandFailed, match="exit code 3"):
        bench.train()
    numbers = orphans(bench.workspace)
    assert len(numbers) == 2
    assert not any(map(lives, numbers))


def test_processes_that_outlive_their_command_are_ended(cell_of: Cells) -> None:
    bench = cell(cell_of, f"{SECOND}|--habit|leave an orphan")
    bench.train()
    assert [lives(pid) for pid in orphans(bench.workspace)] == [False]


def test_an_interruption_ends_the_command_with_its_children(cell_of: Cells) -> None:
    bench = cell(cell_of, f"{SECOND}|--habit|hang with orphans")
    run = bench.run
    first, second = bench.method.stages(run.variant, run.budget)
    stage = first.begin(run, {})
    while stage.iteration < 1:
        stage.step()
    waiting = second.begin(run, stage.product())
    begun = time.monotonic()
    while len(orphans(bench.workspace)) < 2:
        waiting.step()
    assert waiting.iteration == 0
    assert waiting.state() == {"done": None}
    with pytest.raises(UsageError, match="cannot be scored before"):
        waiting.product()
    assert time.monotonic() - begun < 5
    waiting.close()  # type: ignore[attr-defined]
    assert not any(map(lives, orphans(bench.workspace)))


def test_the_command_of_a_killed_harness_is_ended_before_the_next_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cell_of: Cells
) -> None:
    mark = {**os.environ, process.MARK: str(tmp_path / "work")}
    other = {**os.environ, process.MARK: str(tmp_path / "elsewhere")}
    wait = [sys.executable, "-c", "import time; time.sleep(600)"]
    left = subprocess.Popen(wait, env=mark, start_new_session=True)
    stranger = subprocess.Popen(wait, env=other, start_new_session=True)
    try:
        monkeypatch.setenv("STAND_IN_OTHER", str(left.pid))
        text = toml([f"{FIRST}|--habit|need to be alone", SECOND])
        cell_of(text).train()
        assert left.wait(1) < 0
        assert stranger.poll() is None
    finally:
        for each in (left, stranger):
            each.kill()
            each.wait()


def test_without_a_first_process_only_the_mark_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Session 0 belongs to the kernel's threads, and inside a container to its first process."""
    monkeypatch.setattr(os, "getsid", lambda pid: 0)
    assert process.Family(0, str(tmp_path)).living() == {}


@pytest.mark.parametrize("resumes", [False, True])
def test_an_unfinished_command_begins_again_or_goes_on(resumes: bool, tmp_path: Path, cell_of: Cells) -> None:
    head = "resumes = true" if resumes else ""
    note = tmp_path / "note"
    bench = cell(cell_of, f"{SECOND}|--note|{note}|--habit|crash after half", head)
    text = (tmp_path / "method.toml").read_text()
    half = bench.workspace / "output" / "half.pth"
    for number in range(2):
        with pytest.raises(CommandFailed):
            bench.train()
        assert half.exists()
        half.write_text(f"written in attempt {number}")
    lines = note.read_text().splitlines()
    assert ["--resume" in line for line in lines] == [False, resumes]
    bench.method = method_of(tmp_path, text.replace("crash after half", ""))
    bench.train()
    assert half.exists() == resumes
    assert (bench.workspace / "output" / "model-1.pth").exists()
    assert (bench.workspace / "output" / "model-2.pth").read_text().startswith("resumed") == resumes


def test_half_of_the_views_is_an_error_and_the_training_is_kept(
    convex: Scene, tmp_path: Path, cell_of: Cells, shelf: Shelf
) -> None:
    laid = shelf("gs-ir")
    text = toml([FIRST], f"{laid}|--share|0.5", f"{laid}|--light|{{light}}|--share|0.5", "gs-ir")
    bench = cell_of(text)
    trained = bench.train()
    with pytest.raises(CommandFailed, match="did not write all its files") as failure:
        trained.prepare()
    assert "missing: image: test/ours_None" in failure.value.why
    name, light = next(iter(convex.lights.items()))
    with pytest.raises(CommandFailed, match=f"'relight-{name}'") as failure:
        trained.prepare(light)
    assert f"under {name}" in failure.value.why
    bench.method = method_of(tmp_path, text.replace('"--share", "0.5"', '"--share", "1"'))
    bench.train().prepare()


def test_an_image_that_is_cut_off_is_an_error(cell_of: Cells, shelf: Shelf) -> None:
    text = toml([FIRST], f"{shelf('gs-ir')}|--habit|cut", reader="gs-ir")
    trained = cell_of(text).train()
    for _ in range(2):
        with pytest.raises(CommandFailed, match="'render' ended without an error, but") as failure:
            trained.prepare()
        assert "is damaged" in failure.value.why


def test_unrendered_views_are_an_error(cell_of: Cells, shelf: Shelf) -> None:
    text = toml([FIRST], f"{shelf('gs-ir')}\nmaps = ['image', 'indirect']", reader="gs-ir")
    trained = cell_of(text).train()
    with pytest.raises(CommandFailed) as failure:
        trained.prepare()
    assert "1 missing: indirect of all views" in failure.value.why


def test_views_of_another_size_are_named_as_the_reason(
    predicted: dict[str, Maps], tmp_path: Path, cell_of: Cells
) -> None:
    write_svg_ir(tmp_path / "pantry", predicted, step=4)
    text = toml([FIRST], f"--pantry|{tmp_path / 'pantry'}", reader="svg-ir")
    trained = cell_of(text).train()
    with pytest.raises(CommandFailed) as failure:
        trained.prepare()
    assert "a quarter of the resolution" in failure.value.why


def test_a_command_that_leaves_nothing_is_an_error(cell_of: Cells) -> None:
    with pytest.raises(CommandFailed) as failure:
        cell(cell_of, "--name|another").train()
    assert "there is no {output}/model-2.pth" in failure.value.why


def test_files_that_are_gone_or_changed_are_named_before_anything_is_made_of_them(cell_of: Cells) -> None:
    bench = cell(cell_of, SECOND)
    trained = bench.train()
    model = bench.workspace / "output" / "model-1.pth"
    for spoil in (lambda: model.write_text("short"), model.unlink):
        spoil()
        with pytest.raises(DataError, match="'stage-1' of Stand-in has written are missing or changed") as failure:
            bench.method.restore(bench.run, trained.product)
        assert str(bench.workspace) in failure.value.remedy
        with pytest.raises(DataError, match="missing or changed"):
            bench.train()


def test_a_rendering_can_be_stopped(cell_of: Cells, shelf: Shelf) -> None:
    text = toml([FIRST], f"{shelf('gs-ir')}|--habit|hang with orphans", reader="gs-ir")
    bench = cell_of(text)
    trained = bench.train()

    def stop() -> None:
        if len(orphans(bench.workspace)) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        trained.prepare(after_step=stop)
    assert not any(map(lives, orphans(bench.workspace)))


def test_a_program_that_is_not_there_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cell_of: Cells
) -> None:
    monkeypatch.setenv("STAND_IN_PYTHON", str(tmp_path / "no" / "python"))
    with pytest.raises(CommandFailed, match="cannot start") as failure:
        cell(cell_of, SECOND).train()
    assert "No such file" in failure.value.why


def test_a_file_that_may_not_grow_is_reported_as_a_full_disk(tmp_path: Path, cell_of: Cells) -> None:
    """RLIMIT_FSIZE: the kernel refuses in the middle of a write, as on a full disk."""
    bench = cell(cell_of, f"{SECOND}|--habit|fill the disk")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2**20, before[1]))
    try:
        with pytest.raises(CommandFailed, match="exit code 1") as failure:
            bench.train()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert "The disk seems to be full" in failure.value.why
    assert "Free disk space" in failure.value.remedy
    mended(bench, tmp_path).train()


FULL_DISK = """
import sys
from pathlib import Path
from baselines.commands.bench import Bench, Cells, Shelf, method_of, toml
from public_outputs import Maps, write_svg_ir

from radiogs_baselines.commands.process import CommandFailed
from radiogs_datasets import load_scene
import subprocess

folder = Path(sys.argv[1])
work = folder / "work"
work.mkdir()
subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "none", str(work)], check=True)
text = toml(["--name|model-1", "--name|model-2|--habit|fill the disk"])
bench = Bench(method_of(folder, text), load_scene("convex"), work)
try:
    bench.train()
except CommandFailed as error:
    assert "The disk seems to be full" in error.why, error
    assert "Free disk space" in error.remedy, error
else:
    raise AssertionError("it was not full")
assert [state["done"] is not None for state in bench.states] == [True, False]
subprocess.run(["mount", "-t", "tmpfs", "-o", "remount,size=200m", "none", str(work)], check=True)
bench.method = method_of(folder, toml(["--name|model-1", "--name|model-2"]))
bench.states = bench.states[:1]
bench.train()
assert not (work / "output" / "big.pth").exists()
"""


@pytest.mark.slow
def test_a_full_disk_is_named_and_nothing_is_lost(tmp_path: Path) -> None:
    reason = why_nothing_can_be_mounted(tmp_path)
    if reason is not None:
        pytest.skip(reason)
    rooms = [TREE, TREE / "tests", *(TREE / room for room in ("method", "datasets", "baselines"))]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, rooms))}
    run = [*UNSHARE, sys.executable, "-c", FULL_DISK, str(tmp_path)]
    done = subprocess.run(run, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_memory_is_summed_over_all_processes(cell_of: Cells) -> None:
    trained = cell(cell_of, f"{SECOND}|--habit|take memory").train()
    peaks = {name: record["peak_bytes"] or 0 for name, record in trained.product.items()}  # None: ended before a sample
    assert peaks["stage-2"] > 200 * 2**20 > peaks["stage-1"]


def test_a_long_log_keeps_its_beginning_and_its_end(monkeypatch: pytest.MonkeyPatch, cell_of: Cells) -> None:
    command = task.Command
    monkeypatch.setattr(task, "Command", lambda *arguments: command(*arguments, log_limit=10_000))
    bench = cell(cell_of, f"{SECOND}|--habit|talk")
    bench.train()
    text = (bench.workspace / "logs" / "stage-2.log").read_text()
    assert len(text) < 10_100
    assert text.startswith("train: ")
    assert text.endswith("iteration 19999 " + "." * 80 + "\n")
    assert "bytes are left out here" in text
    lines = [line for line in text.split("left out here ...]\n")[1].splitlines() if line.startswith("iteration")]
    numbers = [int(line.split()[1]) for line in lines]
    assert numbers == list(range(20_000 - len(numbers), 20_000))


@pytest.mark.parametrize("name", ["logs/stage-2.log", "done/.stage-2.json.tmp"])
def test_a_link_in_the_place_of_a_log_or_a_record_is_replaced(name: str, tmp_path: Path, cell_of: Cells) -> None:
    bench, victim = cell(cell_of, SECOND), tmp_path / "victim"
    victim.write_text("mine")
    (bench.workspace / name).parent.mkdir(parents=True)
    (bench.workspace / name).symlink_to(victim)
    bench.train()
    assert victim.read_text() == "mine"
    assert not (bench.workspace / name).is_symlink()


@pytest.mark.parametrize("name", ["logs", "done", "begun", "output"])
def test_a_folder_of_the_workspace_that_is_a_link_is_refused(name: str, tmp_path: Path, cell_of: Cells) -> None:
    bench, elsewhere = cell(cell_of, SECOND), tmp_path / "elsewhere"
    elsewhere.mkdir()
    bench.workspace.mkdir()
    (bench.workspace / name).symlink_to(elsewhere)
    with pytest.raises(UsageError, match=f"{name} is a link"):
        bench.train()
    assert not list(elsewhere.iterdir())
