"""Surfels in 3D, drawn by pyvista: a still picture and a turntable. Needs no display if VTK can render offscreen."""

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyvista
from numpy.typing import NDArray
from PIL import Image

FACETS = 12
"""Corners of the polygon that stands for a disk."""

RADIUS = 2.0
"""Radius of a disk in standard deviations; at 2, a Gaussian is at 14 % of its peak."""

SMALLEST_OPACITY = 0.1
"""Surfels below it are left out: drawn as opaque disks, they would hide what they hardly cover."""

ELEVATION = 25.0
"""Elevation of the camera in degrees."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Disks:
    """Surfels as plain arrays.

    centres: [N, 3], world units. tangents: two per surfel, scaled by their standard deviations, [N, 2, 3], world units.
    opacities: [N]. colours: [N, 3], display units in [0, 1].
    """

    centres: Floats
    tangents: Floats
    opacities: Floats
    colours: Floats


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


def draw(disks: Disks, still: Path, turntable: Path, frames: int = 36, size: int = 640) -> list[Path]:
    """Write a PNG, and a GIF of one turn around the Z axis (up); returns both paths. ``size`` is in pixels."""
    mesh = mesh_of(disks)
    plotter = pyvista.Plotter(off_screen=True, window_size=[size, size], lighting="none")
    plotter.background_color = pyvista.Color("white")
    plotter.add_mesh(mesh, scalars="colour", rgb=True)
    middle = np.median(disks.centres, axis=0)
    radius = float(np.quantile(np.linalg.norm(disks.centres - middle, axis=1), 0.98))
    plotter.show(auto_close=False)
    pictures = []
    for frame in range(frames):
        turn, tilt = 2 * np.pi * frame / frames, np.radians(ELEVATION)
        away = np.array([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.sin(tilt)])
        plotter.camera_position = [tuple(middle + 4 * radius * away), tuple(middle), (0.0, 0.0, 1.0)]
        plotter.reset_camera_clipping_range()
        plotter.render()  # without it, a screenshot shows the first frame again
        pictures.append(Image.fromarray(np.asarray(plotter.screenshot(return_img=True))))
    plotter.close()
    pictures[0].save(still)
    pictures[0].save(turntable, save_all=True, append_images=pictures[1:], duration=3600 // frames, loop=0)
    return [still, turntable]


def why_not() -> str | None:
    """VTK's error message if it cannot draw on this machine; None if it can.

    Tried in a separate process, because VTK may end the process in which it fails.
    """
    program = (
        "import pyvista; plotter = pyvista.Plotter(off_screen=True, window_size=[16, 16]);"
        " plotter.add_mesh(pyvista.Disc()); assert plotter.screenshot(return_img=True).max() > 0"
    )
    tried = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    if tried.returncode == 0:
        return None
    messages = tried.stderr.strip().splitlines()
    return messages[-1] if messages else f"VTK ended with {tried.returncode}"
