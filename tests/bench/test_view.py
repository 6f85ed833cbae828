"""``radiogs-bench view``: models of runs are found, and what is missing is said with the right exit code."""

from pathlib import Path

import numpy as np
import pytest
import torch

from bench.fake_method import FakeSweep, asked
from radiogs_bench.cli import main
from radiogs_bench.cli.view import disks_of, surfels_in
from radiogs_bench.store.folder import Store
from radiogs_bench.suites.sweep import write_sweep
from radiogs_core.errors import DataError, UsageError
from radiogs_reports.figures import surfel_view

REQUEST = asked()


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run of which the second row alone is trained."""
    cells = REQUEST.cells()
    write_sweep(Store(tmp_path), REQUEST.manifest([place for place, _ in cells]))
    FakeSweep(tmp_path).run([cells[1][1]])
    return tmp_path


def test_the_first_trained_model_is_found_and_a_row_that_has_none_is_named(run: Path) -> None:
    assert len(surfels_in(run, None)) == len(surfels_in(run, "no-rad")) == 4
    with pytest.raises(DataError, match="for the row 'ours'"):
        surfels_in(run, "ours")
    with pytest.raises(UsageError, match="no row 'our'"):
        surfels_in(run, "our")


def test_where_vtk_cannot_draw_it_is_a_wrong_command_with_what_to_install(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(surfel_view, "why_not", lambda: "no EGL here")
    assert main(["view", str(run)]) == 2
    said = capsys.readouterr().err
    assert "no EGL here" in said
    assert "apt-get install" in said


def test_a_folder_without_a_run_is_missing_data(tmp_path: Path) -> None:
    assert main(["view", str(tmp_path)]) == 3


@pytest.mark.parametrize("colour", ["radiance", "albedo", "normal"])
def test_disks_are_the_surfels_as_plain_arrays(run: Path, colour: str) -> None:
    surfels = surfels_in(run, None)
    disks = disks_of(surfels, colour)
    assert disks.centres == pytest.approx(surfels.centre.numpy())
    assert np.linalg.norm(disks.tangents, axis=-1) == pytest.approx(surfels.log_scale.exp().numpy(), rel=1e-6)
    normals = np.cross(disks.tangents[:, 0], disks.tangents[:, 1])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    assert normals == pytest.approx(surfels.frame[..., 2].numpy(), abs=1e-6)
    assert ((disks.colours >= 0) & (disks.colours <= 1)).all()


def test_a_model_without_surfels_and_a_picture_beyond_bounds_are_refused(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Audit M27: VTK aborted the process at 100000 pixels, and drew nothing of no surfels."""
    for size in ("100000", "0", "9" * 30):
        assert main(["view", str(run), "--size", size]) == 2
        assert "size" in capsys.readouterr().err
    none = surfels_in(run, None).take(torch.zeros(0, dtype=torch.long))
    monkeypatch.setattr("radiogs_bench.cli.view.surfels_in", lambda folder, row: none)
    assert main(["view", str(run)]) == 3
    assert "no surfels left" in capsys.readouterr().err
