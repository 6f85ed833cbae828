"""``radiogs-bench view``: models of runs are found, and missing ones are reported with the right exit code."""

import json
import sys
from pathlib import Path

import pytest
import torch
from PIL import Image

from bench.fake_method import FakeSweep, asked, write_sweep
from radiogs_bench.cli import main
from radiogs_bench.export.trained_surfels import surfels_in
from radiogs_bench.store.folder import Store
from radiogs_core.errors import DataError, UsageError
from radiogs_reports.figures import surfel_view

REQUEST = asked()


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run of which the second row alone is trained."""
    cells = REQUEST.cells
    write_sweep(Store(tmp_path), REQUEST.manifest())
    FakeSweep(tmp_path).run([cells[1][1]])
    return tmp_path


def test_the_first_trained_model_is_found_and_a_row_that_has_none_is_named(run: Path) -> None:
    assert len(surfels_in(run, None)) == len(surfels_in(run, "no-rad")) == 4
    with pytest.raises(DataError, match="for the row 'ours'"):
        surfels_in(run, "ours")
    with pytest.raises(UsageError, match="no row 'our'"):
        surfels_in(run, "our")


def test_a_page_that_turns_a_still_and_a_film_are_written(run: Path) -> None:
    assert main(["view", str(run), "--frames", "3", "--size", "16"]) == 0
    figures = run / "figures"
    with Image.open(figures / "surfels.png") as still, Image.open(figures / "surfels.gif") as film:
        assert still.size == film.size == (16, 16)
        assert film.n_frames >= 2, "equal frames are stored once"
    page = (figures / "surfels.html").read_text(encoding="utf-8")
    stored = json.loads(page.split('id="surfels-model">')[1].split("</script>")[0])
    assert stored["count"] == 4


def test_without_a_screen_a_window_is_refused_before_any_work(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert main(["view", str(run), "--window"]) == 2
    assert "open figures/surfels.html in a browser" in capsys.readouterr().err
    assert not (run / "figures").exists()


def test_a_window_shows_the_discs_lit_where_they_have_no_light_of_their_own(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = []
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(
        surfel_view, "show", lambda arrays, colour: shown.append((len(arrays["surfels/centre"]), colour))
    )
    for colour in ("radiance", "albedo"):
        assert main(["view", str(run), "--window", "--colour", colour, "--frames", "1", "--size", "16"]) == 0
    assert shown == [(4, "radiance"), (4, "albedo")]


def test_a_folder_without_a_run_is_missing_data(tmp_path: Path) -> None:
    assert main(["view", str(tmp_path)]) == 3


def test_a_model_without_surfels_and_a_picture_beyond_bounds_are_refused(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Audit M27: VTK aborted the process at 100000 pixels, and drew nothing of no surfels."""
    for size in ("100000", "0", "9" * 30):
        assert main(["view", str(run), "--size", size]) == 2
        assert "size" in capsys.readouterr().err
    none = surfels_in(run, None).take(torch.zeros(0, dtype=torch.long))
    monkeypatch.setattr("radiogs_bench.export.trained_surfels.surfels_in", lambda folder, row: none)
    assert main(["view", str(run)]) == 3
    assert "no surfels left" in capsys.readouterr().err
