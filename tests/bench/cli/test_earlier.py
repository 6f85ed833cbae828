"""Runs and trainings keep what is in their folder: reports of another run, and another model's files."""

from collections.abc import Callable
from pathlib import Path

import pytest

import radiogs_bench as rb
from bench import fake_method
from radiogs_bench.cli.main import main
from radiogs_bench.installed_methods import substitutes
from radiogs_bench.runs.trained_folder import read_about
from radiogs_core.errors import UsageError

FakeRun = Callable[..., int]


@pytest.mark.slow
def test_reports_under_another_protocol_do_not_replace_the_first(
    fake_run: FakeRun, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fake_run("ablations")
    first = {path.name: path.read_bytes() for path in tmp_path.glob("*.*") if path.name != "sweep.json"}
    assert fake_run("ablations", "--protocol", "radiogs") == 0
    kept = tmp_path / "earlier" / "ablations-smoke-default-cpu"
    assert {path.name: path.read_bytes() for path in kept.glob("*.*")} == first
    assert (kept / "tables" / "ablation.md").is_file()
    assert (tmp_path / "report.html").read_bytes() != first["report.html"]
    assert f"are kept in {kept}" in capsys.readouterr().err


@pytest.mark.slow
def test_the_same_run_with_more_seeds_keeps_nothing_apart(fake_run: FakeRun, tmp_path: Path) -> None:
    fake_run("ablations")
    fake_run("ablations", "--seeds", "3")
    assert not (tmp_path / "earlier").exists()


def test_files_that_no_record_lists_and_links_stay(fake_run: FakeRun, tmp_path: Path) -> None:
    fake_run("ablations")
    outside = tmp_path.parent / "outside.txt"
    outside.write_text("mine")
    (tmp_path / "notes.md").write_text("mine")
    (tmp_path / "report.tex").unlink()
    (tmp_path / "report.tex").symlink_to(outside)
    with (tmp_path / "reports.txt").open("a") as record:
        record.write("0  ../outside.txt\n0  cells/../../outside.txt\n")
    fake_run("ablations", "--protocol", "radiogs")
    assert outside.read_text() == "mine"
    assert (tmp_path / "notes.md").read_text() == "mine"
    assert not (tmp_path / "earlier" / "ablations-smoke-default-cpu" / "report.tex").exists()


def train(folder: Path, *further: str) -> int:
    return main(["train", "convex", "--preset", "smoke", "--no-score", "--out", str(folder), *further])


@pytest.mark.slow
def test_a_finished_model_is_replaced_only_with_force(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(substitutes, fake_method.FAKE.name, fake_method.FAKE)
    assert train(tmp_path) == 0
    first = read_about(tmp_path)
    (tmp_path / "surfels.ply").write_text("of the first model")
    (tmp_path / "render").mkdir()
    (tmp_path / "render" / "a.png").write_text("of the first model")
    capsys.readouterr()
    assert train(tmp_path, "--seed", "1") == 2
    assert "holds another trained model: radiogs of scene 'convex', preset smoke, seed 0" in capsys.readouterr().err
    assert read_about(tmp_path) == first
    assert train(tmp_path, "--seed", "1", "--force") == 0
    kept = tmp_path / f"replaced-{first['training_key']}"
    assert (kept / "surfels.ply").is_file()
    assert (kept / "render" / "a.png").is_file()
    assert not (tmp_path / "render").exists()
    assert read_about(tmp_path)["seed"] == 1


@pytest.mark.slow
def test_training_from_python_keeps_the_commands_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(substitutes, fake_method.FAKE.name, fake_method.FAKE)
    assert train(tmp_path / "shell") == 0
    said: list[str] = []
    model = rb.train("radiogs", "convex", preset="smoke", out=tmp_path / "python", say=said.append)
    assert read_about(tmp_path / "python") == read_about(tmp_path / "shell")
    assert [path.name for path in model.files] == ["trained.json"]
    assert model.method == "radiogs"
    assert model.seconds is not None
    with pytest.raises(UsageError, match="holds another trained model"):
        rb.train("radiogs", "convex", preset="smoke", seed=1, out=tmp_path / "python")
    assert not said
    rb.train("radiogs", "convex", preset="smoke", seed=1, out=tmp_path / "python", replace=True, say=said.append)
    assert ["the files of the model that was here are in" in line for line in said] == [True]
    assert read_about(tmp_path / "python")["seed"] == 1


def test_training_from_python_refuses_an_unknown_option() -> None:
    with pytest.raises(UsageError, match="unknown option 'replaces'"):
        rb.train("radiogs", "convex", replaces=True)  # type: ignore[call-arg]
