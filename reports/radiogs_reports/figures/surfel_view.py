"""Surfels as opaque discs in a window of pyvista, to turn: their places and normals, which blending hides."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyvista
from numpy.typing import NDArray

from ..maps import display

FACETS = 12
"""Corners of the polygon that approximates a disk."""

RADIUS = 2.0
"""Radius of a disk in standard deviations; at 2, a Gaussian is at 14 % of its peak."""

SMALLEST_OPACITY = 0.1
"""Surfels below it are left out: drawn as opaque disks, they would hide what they hardly cover."""

Arrays = Mapping[str, NDArray[Any]]
"""Arrays of a model by name, ``surfels/...``, as cells keep them."""


def colours_of(arrays: Arrays, colour: str) -> NDArray[Any]:
    """Colours of surfels [N, 3], display units, by radiance, albedo, normal or roughness."""
    if colour == "normal":
        across = np.cross(*arrays["surfels/tangents"].swapaxes(0, 1))
        return across / np.linalg.norm(across, axis=-1, keepdims=True) * 0.5 + 0.5
    values = arrays[f"surfels/{colour}"].astype(float)
    return values[:, None].repeat(3, 1) if colour == "roughness" else display(values)


def mesh_of(arrays: Arrays, colour: str) -> pyvista.PolyData:
    """A polygon in its own colour for each surfel of at least ``SMALLEST_OPACITY``."""
    kept = arrays["surfels/opacity"] >= SMALLEST_OPACITY
    count = int(kept.sum())
    angles = 2 * np.pi * np.arange(FACETS) / FACETS
    circle = RADIUS * np.stack([np.cos(angles), np.sin(angles)])
    across = np.einsum("ac,nad->ncd", circle, arrays["surfels/tangents"][kept])
    corners = arrays["surfels/centre"][kept][:, None] + across
    places = np.arange(count * FACETS).reshape(count, FACETS)
    faces = np.concatenate([np.full((count, 1), FACETS), places], 1)
    mesh = pyvista.PolyData(corners.reshape(-1, 3), faces=faces.ravel())
    mesh.cell_data["colour"] = np.rint(np.clip(colours_of(arrays, colour)[kept], 0, 1) * 255).astype(np.uint8)
    return mesh


def plotted(arrays: Arrays, colour: str, off_screen: bool = False, size: int = 800) -> pyvista.Plotter:
    """A window of the surfels as opaque discs; for their albedo, shaded by lamps of the window."""
    lit = colour == "albedo"
    plotter = pyvista.Plotter(off_screen=off_screen, window_size=[size, size], lighting="light kit" if lit else "none")
    plotter.background_color = pyvista.Color("white")
    plotter.add_mesh(mesh_of(arrays, colour), scalars="colour", rgb=True, lighting=lit)
    plotter.renderer.view_vector((1.0, -1.0, 0.6), (0.0, 0.0, 1.0))
    return plotter


def show(arrays: Arrays, colour: str) -> None:
    """Open a window and wait until it is closed."""
    plotted(arrays, colour).show(title="radiogs-bench")
