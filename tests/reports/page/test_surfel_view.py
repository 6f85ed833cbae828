"""Surfels in a window: disks at their places, near ones before far ones; skipped where VTK cannot draw."""

import subprocess
import sys

import numpy as np
import pytest

from radiogs_reports.figures.surfel_view import FACETS, RADIUS, SMALLEST_OPACITY, Arrays, colours_of, mesh_of, plotted

TRIED = (
    "import pyvista; plotter = pyvista.Plotter(off_screen=True, window_size=[16, 16]);"
    " plotter.add_mesh(pyvista.Disc()); assert plotter.screenshot(return_img=True).max() > 0"
)
"""Tried in a separate process, because VTK may end the process in which it fails."""


def disks(size: float = 1.0) -> Arrays:
    """A red wall at x = 1 and a blue one at x = -1, both of four disks, and one that is all but transparent."""
    places = [(y, z) for y in (-0.3, 0.3) for z in (-0.3, 0.3)]
    centres = [(x, y, z) for x in (1.0, -1.0) for y, z in places]
    colours = [(1.0, 0, 0)] * 4 + [(0, 0, 1.0)] * 4
    tangents = np.tile(size * np.array([[0, 0.2, 0], [0, 0, 0.1]]), (9, 1, 1))
    opacities = np.full(9, 0.9)
    opacities[8] = SMALLEST_OPACITY / 2
    return {
        "surfels/centre": np.array([*centres, (0, 0, 0)]),
        "surfels/tangents": tangents,
        "surfels/opacity": opacities,
        "surfels/radiance": np.array([*colours, (0, 1.0, 0)]),
        "surfels/roughness": opacities,
    }


def test_colours_are_in_display_units_and_normals_of_unit_length() -> None:
    arrays = {**disks(), "surfels/albedo": np.full((9, 3), 0.214041)}
    assert colours_of(arrays, "albedo") == pytest.approx(np.full((9, 3), 0.5), abs=1e-4)
    assert colours_of(arrays, "normal")[0] == pytest.approx([1, 0.5, 0.5])
    assert (colours_of(arrays, "roughness")[8] == SMALLEST_OPACITY / 2).all()


def test_disks_are_ellipses_of_two_deviations_in_their_own_plane() -> None:
    mesh = mesh_of(disks(), "radiance")
    assert mesh.n_cells == 8
    assert mesh.n_points == 8 * FACETS
    offsets = np.asarray(mesh.points).reshape(8, FACETS, 3) - disks()["surfels/centre"][:8, None]
    assert np.abs(offsets[..., 0]).max() < 1e-6
    assert (offsets[..., 1] / 0.2) ** 2 + (offsets[..., 2] / 0.1) ** 2 == pytest.approx(RADIUS**2, rel=1e-4)


def test_the_near_wall_hides_the_far_one_from_both_sides() -> None:
    tried = subprocess.run([sys.executable, "-c", TRIED], capture_output=True, text=True, check=False)
    if tried.returncode:
        pytest.skip(f"VTK cannot draw here: {tried.stderr.strip().splitlines()[-1:]}")
    for side, near, far in ((1.0, [255, 0, 0], [0, 0, 255]), (-1.0, [0, 0, 255], [255, 0, 0])):
        plotter = plotted(disks(size=4), "radiance", off_screen=True, size=96)
        plotter.renderer.view_vector((side, 0.0, 0.0), (0.0, 0.0, 1.0))
        seen = np.asarray(plotter.screenshot(return_img=True)).reshape(-1, 3).astype(int)
        plotter.close()
        assert (seen == near).all(-1).mean() > 0.2
        assert not (seen == far).all(-1).any()
