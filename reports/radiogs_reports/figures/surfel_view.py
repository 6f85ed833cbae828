"""Surfels as opaque discs in a window of pyvista, to turn: their places and normals, which blending hides."""

from dataclasses import dataclass

import numpy as np
import pyvista
from numpy.typing import NDArray

FACETS = 12
"""Corners of the polygon that stands for a disk."""

RADIUS = 2.0
"""Radius of a disk in standard deviations; at 2, a Gaussian is at 14 % of its peak."""

SMALLEST_OPACITY = 0.1
"""Surfels below it are left out: drawn as opaque disks, they would hide what they hardly cover."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Disks:
    """Surfels as plain arrays."""

    centres: Floats
    """[N, 3], world units."""
    tangents: Floats
    """Two for each surfel, scaled by their standard deviations, [N, 2, 3], world units."""
    opacities: Floats
    """[N]."""
    colours: Floats
    """[N, 3], display units in [0, 1]."""


def mesh_of(disks: Disks) -> pyvista.PolyData:
    """A polygon in its own colour for each surfel of at least ``SMALLEST_OPACITY``."""
    kept = disks.opacities >= SMALLEST_OPACITY
    count = int(kept.sum())
    angles = 2 * np.pi * np.arange(FACETS) / FACETS
    circle = RADIUS * np.stack([np.cos(angles), np.sin(angles)])
    corners = disks.centres[kept][:, None] + np.einsum("ac,nad->ncd", circle, disks.tangents[kept])
    places = np.arange(count * FACETS).reshape(count, FACETS)
    faces = np.concatenate([np.full((count, 1), FACETS), places], 1)
    mesh = pyvista.PolyData(corners.reshape(-1, 3), faces=faces.ravel())
    mesh.cell_data["colour"] = np.rint(np.clip(disks.colours[kept], 0, 1) * 255).astype(np.uint8)
    return mesh


def plotted(disks: Disks, lit: bool, off_screen: bool = False, size: int = 800) -> pyvista.Plotter:
    """A window of the surfels as opaque discs. ``lit``: shaded by lamps of the window."""
    plotter = pyvista.Plotter(off_screen=off_screen, window_size=[size, size], lighting="light kit" if lit else "none")
    plotter.background_color = pyvista.Color("white")
    plotter.add_mesh(mesh_of(disks), scalars="colour", rgb=True, lighting=lit)
    plotter.renderer.view_vector((1.0, -1.0, 0.6), (0.0, 0.0, 1.0))
    return plotter


def show(disks: Disks, lit: bool) -> None:
    """Open a window and wait until it is closed."""
    plotted(disks, lit).show(title="radiogs-bench")
