"""Surfels in three dimensions: disks where they should be, seen from where they should be, skipped where VTK fails."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from radiogs_reports.figures import surfel_view
from radiogs_reports.figures.surfel_view import FACETS, RADIUS, SMALLEST_OPACITY, Disks, draw, mesh_of, why_not


def disks() -> Disks:
    """A red wall at x = 1 and a blue one at x = -1, both of four disks, and one that is all but transparent."""
    places = [(y, z) for y in (-0.3, 0.3) for z in (-0.3, 0.3)]
    centres = [(x, y, z) for x in (1.0, -1.0) for y, z in places]
    colours = [(1.0, 0, 0)] * 4 + [(0, 0, 1.0)] * 4
    tangents = np.tile(np.array([[0, 0.2, 0], [0, 0, 0.1]]), (9, 1, 1))
    opacities = np.full(9, 0.9)
    opacities[8] = SMALLEST_OPACITY / 2
    return Disks(np.array([*centres, (0, 0, 0)]), tangents, opacities, np.array([*colours, (0, 1.0, 0)]))


def test_disks_are_ellipses_of_two_deviations_in_their_own_plane() -> None:
    mesh = mesh_of(disks())
    assert mesh.n_cells == 8
    assert mesh.n_points == 8 * FACETS
    offsets = np.asarray(mesh.points).reshape(8, FACETS, 3) - disks().centres[:8, None]
    assert np.abs(offsets[..., 0]).max() < 1e-6
    assert (offsets[..., 1] / 0.2) ** 2 + (offsets[..., 2] / 0.1) ** 2 == pytest.approx(RADIUS**2, rel=1e-4)


def test_the_still_shows_the_near_wall_and_the_turntable_comes_around(tmp_path: Path) -> None:
    reason = why_not()
    if reason is not None:
        pytest.skip(f"VTK cannot draw here: {reason}")
    still, turntable = draw(disks(), tmp_path / "a.png", tmp_path / "a.gif", frames=4, size=96)
    with Image.open(still) as image:
        pixels = np.asarray(image.convert("RGB")).astype(int)
    coloured = pixels[(pixels.max(-1) - pixels.min(-1)) > 100]
    red = (coloured[:, 0] > coloured[:, 2]).mean()
    assert 0.5 < red < 1
    with Image.open(turntable) as film:
        assert film.n_frames == 4
        film.seek(2)
        pixels = np.asarray(film.convert("RGB")).astype(int)
    coloured = pixels[(pixels.max(-1) - pixels.min(-1)) > 100]
    assert (coloured[:, 0] > coloured[:, 2]).mean() == pytest.approx(1 - red, abs=0.1)


def test_where_vtk_dies_it_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    dying = tmp_path / "python"
    dying.write_text("#!/bin/sh\necho 'no EGL here' >&2\nexit 139\n")
    dying.chmod(0o755)
    monkeypatch.setattr(surfel_view.sys, "executable", str(dying))
    assert why_not() == "no EGL here"
