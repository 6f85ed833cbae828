"""Surfels in three dimensions by pyvista: a still, and a turntable; without a display where VTK can."""

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyvista
from numpy.typing import NDArray
from PIL import Image

FACETS = 12
"""Corners of a disk: round enough at the size that a surfel has on the screen."""

REACH = 2.0
"""Standard deviations that a disk reaches from the centre; at 2, a Gaussian is at 14 % of its peak."""

SMALLEST_OPACITY = 0.1
"""Surfels below are left out: they would hide what they hardly cover."""

ELEVATION = 25.0
"""Degrees above the horizon from which surfels are seen."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Disks:
    """Surfels as plain arrays: centres [N, 3], the two tangents scaled by their deviations [N, 2, 3] (world units),
    opacities [N] and display colours [N, 3] in [0, 1].
    """  # fmt: skip

    centres: Floats
    tangents: Floats
    opacities: Floats
    colours: Floats


def mesh_of(disks: Disks) -> pyvista.PolyData:
    """A polygon for each surfel that is opaque enough, coloured by its own colour."""
    kept = disks.opacities >= SMALLEST_OPACITY
    count = int(kept.sum())
    angles = 2 * np.pi * np.arange(FACETS) / FACETS
    circle = REACH * np.stack([np.cos(angles), np.sin(angles)])
    corners = disks.centres[kept][:, None] + np.einsum("ac,nad->ncd", circle, disks.tangents[kept])
    places = np.arange(count * FACETS).reshape(count, FACETS)
    faces = np.concatenate([np.full((count, 1), FACETS), places], 1)
    mesh = pyvista.PolyData(corners.reshape(-1, 3), faces=faces.ravel())
    mesh.cell_data["colour"] = np.rint(np.clip(disks.colours[kept], 0, 1) * 255).astype(np.uint8)
    return mesh


def draw(disks: Disks, still: Path, turntable: Path, frames: int = 36, size: int = 640) -> list[Path]:
    """Write a PNG, and a GIF of one turn around the vertical; returns both. World axes: Z is up."""
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
        plotter.render()  # a screenshot by itself would show the first frame again
        pictures.append(Image.fromarray(np.asarray(plotter.screenshot(return_img=True))))
    plotter.close()
    pictures[0].save(still)
    pictures[0].save(turntable, save_all=True, append_images=pictures[1:], duration=3600 // frames, loop=0)
    return [still, turntable]


def why_not() -> str | None:
    """What VTK says where it cannot draw here; None where it can.

    Tried in a process of its own: where there is no way to draw, VTK may end the process that asks.
    """
    program = (
        "import pyvista; plotter = pyvista.Plotter(off_screen=True, window_size=[16, 16]);"
        " plotter.add_mesh(pyvista.Disc()); assert plotter.screenshot(return_img=True).max() > 0"
    )
    tried = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    if tried.returncode == 0:
        return None
    said = tried.stderr.strip().splitlines()
    return said[-1] if said else f"VTK ended with {tried.returncode}"
