"""The parts of a scene's recipe: solids with their materials, lights, and cameras with the places where they stand."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .patterns import Point
from .solids import Solid


@dataclass(frozen=True)
class Rig:
    """Cameras on a patch of a sphere that looks at ``target``; angles in degrees, azimuth from +X to +Y."""

    target: Point
    radius: float
    azimuth: tuple[float, float]
    elevation: tuple[float, float]
    field_of_view: float = 40.0


TEST_RATIO = 4
"""Ratio of a test view's samples per pixel to a training view's: test views are ground truth and get half the noise."""


@dataclass(frozen=True)
class Pictures:
    """Numbers of views, pixels per side, and length of light paths of a rendering.

    ``depth`` counts the light as a vertex: 8 ends at the light after seven surfaces. Deep white basins keep on
    scattering: in ``bowl`` a depth of 8 lacks 6 % of the indirect light, so that it comes with a depth of 32.
    ``samples``: paths a pixel of a training view. Test views have ``TEST_RATIO`` times as many. ``train``: None for the
    number of the recipe.
    """

    size: int = 96
    train: int | None = None
    test: int = 8
    depth: int = 8
    samples: int = 256


@dataclass(frozen=True)
class Recipe:
    """One scene: its solids, cameras and purpose.

    ``kind``: scenes of one kind are averaged first in means over kinds. ``choices``: whether a method's settings may be
    chosen by results on this scene, or results are reported only. ``train``: number of training views.
    """

    name: str
    purpose: str
    solids: tuple[Solid, ...]
    rig: Rig
    training_light: str = "sky"
    relight: tuple[str, ...] = ("sunset", "overcast")
    kind: str = "single effects"
    choices: Literal["tuned on", "reported only"] = "tuned on"
    train: int = 48


PLASTIC_RATIO = 1.3247179572447460
"""Real root of x^3 = x + 1; its inverse powers generate the R2 low-discrepancy sequence."""


@dataclass(frozen=True)
class Pinhole:
    """A square view: camera-to-world matrix in OpenGL axes, field of view in degrees, side in pixels."""

    to_world: NDArray[np.float64]
    field_of_view: float
    size: int

    def rays(self, subpixels: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Origins and directions of unit z-depth through a grid of subpixels, rows first; [(size subpixels)^2, 3]."""
        fine = self.size * subpixels
        focal = 0.5 * fine / np.tan(np.radians(self.field_of_view) / 2)
        column, row = np.meshgrid(np.arange(fine) + 0.5 - fine / 2, np.arange(fine) + 0.5 - fine / 2)
        local = np.stack([column / focal, -row / focal, -np.ones_like(row)], -1).reshape(-1, 3)
        directions = local @ self.to_world[:3, :3].T
        return np.broadcast_to(self.to_world[:3, 3], directions.shape), directions


def pinhole(rig: Rig, place: int, size: int) -> Pinhole:
    """The rig's camera number ``place``; they cover its patch as a low-discrepancy sequence, evenly in solid angle."""
    along, across = (0.5 + (place + 1) * np.array([PLASTIC_RATIO**-1, PLASTIC_RATIO**-2])) % 1
    azimuth = np.radians(rig.azimuth[0] + along * (rig.azimuth[1] - rig.azimuth[0]))
    low, high = np.sin(np.radians(rig.elevation))
    height = low + across * (high - low)
    flat = np.sqrt(1 - height**2)
    x, y, z = backward = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), height])
    right = np.array([-y, x, 0.0]) / np.linalg.norm([-y, x, 0.0])
    upwards = [-z * right[1], z * right[0], x * right[1] - y * right[0]]  # backward x right; np.cross is slow for one
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([right, upwards, backward], -1)
    matrix[:3, 3] = np.array(rig.target) + rig.radius * backward
    return Pinhole(matrix, rig.field_of_view, size)
