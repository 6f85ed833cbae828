"""How commands end without a failed cell or a changed figure: with the cause, and an exit code of its own."""

import os
import resource
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest

from bench.fake_method import FAKE, FakeSweep, asked, write_sweep
from radiogs_bench.cli import main
from radiogs_bench.errors import UNEXPECTED, Killed, StoreError, exit_code, explain
from radiogs_bench.installed_methods import substitutes
from radiogs_bench.methods import budget_of, variant_of
from radiogs_bench.results import reports
from radiogs_bench.results.reports import write
from radiogs_bench.runs.cell import Work, cell_of
from radiogs_bench.runs.engines import run as engines
from radiogs_bench.runs.engines.choice import Engine
from radiogs_bench.runs.sweep import Sweep
from radiogs_bench.store.folder import Store, product_name
from radiogs_bench.suites.paper import ABLATIONS
from radiogs_bench.suites.suite import Suite
from radiogs_bench.whole_runs import other_run
from radiogs_datasets import load_scene

WITH_FIGURES = True


def finished(folder: Path, suite: Suite = ABLATIONS) -> Sweep:
    sweep, request = FakeSweep(folder), asked(1, suite)
    cells = request.cells
    manifest = request.manifest()
    write_sweep(sweep.store, manifest)
    sweep.run([cell for _, cell in cells])
    return manifest


@pytest.mark.slow
def test_a_run_reports_itself_where_another_was_started_in_its_folder(tmp_path: Path) -> None:
    """Audit M9: the first run printed the second one's table and wrote no report of its own."""
    from dataclasses import replace

    first = finished(tmp_path)
    store, second = Store(tmp_path), replace(ABLATIONS, name="second", title="Another")
    write_sweep(store, asked(1, second).manifest())
    summary, written = write(store, first)
    assert summary["suite"] == "ablations"
    assert tmp_path / "ablations.md" in written
    assert "Meanwhile suite 'second' was started" in other_run(store, first)
    write_sweep(store, first)
    assert other_run(store, first) == ""


@pytest.mark.slow
def test_reports_do_not_overwrite_targets_of_links(run: Path, tmp_path: Path) -> None:
    """Audit M18."""
    mine = tmp_path / "mine"
    mine.write_text("mine")
    for name in ("report.html", "ablations.md", "contact_sheet.png", "reports.txt", "summary.json"):
        (run / name).unlink(missing_ok=True)
        (run / name).symlink_to(mine)
    assert main(["report", str(run)]) == 0
    assert mine.read_text() == "mine"
    assert not (run / "report.html").is_symlink()


def test_a_folder_of_reports_that_is_a_link_is_refused(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Audit M18."""
    (tmp_path / "elsewhere").mkdir()
    (run / "figures").symlink_to(tmp_path / "elsewhere")
    assert main(["report", str(run)]) == 2
    assert "figures is a link to" in capsys.readouterr().err
    assert not list((tmp_path / "elsewhere").iterdir())


@pytest.mark.slow
@pytest.mark.parametrize(("bound", "first"), [(100, ".md"), (18_000, ".png"), (30_000, "sheet"), (200_000, ".html")])
def test_reports_that_do_not_fit_on_the_disk_are_explained_and_made_later(
    bound: int, first: str, run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Audit M22: a full disk while reports are written was a traceback. ``first`` is a file that does not fit."""
    whole, writing = files_of(run), reports.write_reports

    def scarce(out: Path, *told: Any) -> list[Path]:
        limits = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (bound, limits[1]))
        try:
            return writing(out, *told)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)

    monkeypatch.setattr(reports, "write_reports", scarce)
    assert main(["report", str(run)]) == UNEXPECTED
    said = capsys.readouterr().err
    assert f"no space left to write {run}" in said
    assert "Traceback" not in said
    assert {name: content for name, content in files_of(run).items() if name in whole} == whole
    monkeypatch.setattr(reports, "write_reports", writing)
    assert main(["report", str(run)]) == 0
    late = [name for name, content in files_of(run).items() if first in name and len(content) > bound]
    assert late, "the bound is below no file of this kind"


def files_of(run: Path) -> dict[str, bytes]:
    return {str(path.relative_to(run)): path.read_bytes() for path in run.rglob("*") if path.is_file()}


@pytest.mark.slow
def test_only_run_promises_to_make_results_again(
    run: Path, caplog: pytest.LogCaptureFixture, capsys: pytest.CaptureFixture[str]
) -> None:
    """Audit M37: commands that make nothing promised "will be made again"; ``verify`` names the command that does."""
    damaged = sorted((run / "cells").glob("*.json"))[0]
    damaged.write_bytes(b"{")
    assert main(["verify", str(run)]) == 3
    assert "The same `run` would finish 1 cells and train 0 stages" in capsys.readouterr().out
    for command in ("status", "report", "export"):
        assert main([command, str(run)]) == 0
        words = caplog.text + "".join(capsys.readouterr())
        assert "damaged" in words
        assert "again" not in words
    assert "and is not used" in caplog.text


def test_an_unexpected_error_is_neither_a_failed_cell_nor_a_regression(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Audit M25: an uncaught traceback was exit code 1."""

    def fault(store: Store) -> None:
        raise AssertionError("never seen before")

    monkeypatch.setattr(Store, "results", fault)
    assert main(["status", str(run)]) == UNEXPECTED
    said = capsys.readouterr().err
    assert "never seen before" in said
    assert "Traceback" in said
    assert said.endswith(f"(exit code {UNEXPECTED})\n")


@pytest.mark.parametrize("name", ["sweep.json", "cells"])
def test_an_unreadable_file_is_an_explained_error(name: str, run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Audit M24: only a missing file was expected. A folder in a file's place cannot be read by anybody."""
    places = [run / name] if name == "sweep.json" else sorted((run / name).glob("*.json"))[:1]
    for path in places:
        path.unlink()
        path.mkdir()
    for command in ("status", "report", "export", "gate"):
        more = ["--baseline", str(run / "b.json"), "--update"] if command == "gate" else []
        assert main([command, str(run), *more]) == UNEXPECTED
        said = capsys.readouterr().err
        assert f"cannot read {places[0]}" in said
        assert "Traceback" not in said


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_damage_in_a_read_only_folder_is_reported(run: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = sorted((run / "cells").glob("*.json"))[0]
    path.write_bytes(b"")
    for folder in (run / "cells", run):
        folder.chmod(0o555)
    try:
        assert Store(run).result(path.stem) is None
        assert "cannot be moved" in caplog.text
    finally:
        for folder in (run, run / "cells"):
            folder.chmod(0o755)


def test_a_second_training_in_a_folder_is_refused_with_the_first_ones_process(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Audit M26: the second ended in a raw ``Claimed``."""
    with patch.dict(substitutes, {FAKE.name: FAKE}):
        work = Work(variant_of(FAKE, {}), budget_of(FAKE, "smoke"))
        first = cell_of(FAKE, load_scene("convex"), work, FAKE.name).stages[0]
        with Store(tmp_path).claim(product_name(first.key).replace("/", "-")):
            assert main(["train", "convex", "--preset", "smoke", "--out", str(tmp_path)]) == UNEXPECTED
    said = capsys.readouterr().err
    assert f"{tmp_path} is in use by process {os.getpid()}" in said
    assert "Traceback" not in said


def by_pool(commands: Sequence[Sequence[str]], folder: Path, monkeypatch: pytest.MonkeyPatch) -> engines.Ended:
    """A pool of these commands on cells of which none is finished."""
    bench = FakeSweep(folder).bench
    run_pool = engines.run_pool
    monkeypatch.setattr(engines, "run_pool", lambda _, *given: run_pool(commands, *given))
    return engines.run_by_pool(asked(1), bench, Engine("pool", workers=len(commands)))


KILL = [sys.executable, "-c", "import os, signal; os.kill(os.getpid(), signal.SIGKILL)"]


def test_killed_workers_are_named_in_the_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Audit M36: exit code 1 without a word."""
    ended = by_pool([KILL, KILL], tmp_path, monkeypatch)
    assert ended.code == UNEXPECTED
    (failure,) = ended.failures
    assert failure.what == "2 of 2 workers were killed (signal 9, Killed), and 5 cells are not finished"
    assert "out of memory" in explain(failure)
    assert exit_code(failure) == exit_code(StoreError("")) == UNEXPECTED


def test_a_failed_worker_decides_the_exit_code_before_a_killed_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ended = by_pool([KILL, [sys.executable, "-c", "raise SystemExit(4)"]], tmp_path, monkeypatch)
    assert ended.code == 4
    assert "1 of 2 workers were killed" in ended.failures[0].what


@pytest.mark.parametrize(("code", "said"), [(0, [Killed]), (1, []), (139, [])])
def test_unfinished_cells_never_end_with_exit_code_0(
    code: int, said: list[type], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ended = by_pool([[sys.executable, "-c", f"raise SystemExit({code})"]], tmp_path, monkeypatch)
    assert ended.code == (1 if code == 1 else UNEXPECTED)
    assert [type(each) for each in ended.failures] == said
