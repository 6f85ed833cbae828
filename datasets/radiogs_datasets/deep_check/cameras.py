"""Cameras of many views as arrays, and the likely wrong readings of a camera: conventions, lenses, flipped images.

Reflections of an image are written as cameras with left-handed axes, so that every alternative is a camera.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from radiogs_core.scene.camera import Camera

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cameras:
    """Pinhole cameras with OpenCV axes; the axes may be left-handed."""

    axes: Array
    """[views, 3, 3]: columns are the right, down and forward axes in the world."""
    centre: Array
    """[views, 3], world units."""
    focal: Array
    """[views, 2]: fx and fy, pixels."""
    principal: Array
    """[views, 2]: cx and cy, pixels, centres of pixels at +0.5."""
    size: Array
    """[views, 2]: width and height, pixels."""

    def __len__(self) -> int:
        return len(self.centre)

    def take(self, places: Sequence[int] | NDArray[np.int64]) -> "Cameras":
        """The cameras at some places."""
        chosen = np.asarray(places, dtype=np.int64)
        return Cameras(*(getattr(self, name)[chosen] for name in FIELDS))

    def with_one(self, place: int, other: "Cameras") -> "Cameras":
        """A copy whose camera at ``place`` is the single camera of ``other``."""
        parts = {name: getattr(self, name).copy() for name in FIELDS}
        for name in FIELDS:
            parts[name][place] = getattr(other, name)[0]
        return Cameras(**parts)

    def rays(self, pixels: Array) -> Array:
        """World directions with z-depth 1 through image points [views, points, 2]."""
        slope = (pixels - self.principal[:, None]) / self.focal[:, None]
        local = np.concatenate([slope, np.ones_like(slope[..., :1])], -1)
        return np.einsum("vij,vpj->vpi", self.axes, local)

    def project(self, points: Array) -> tuple[Array, Array]:
        """Image points [views, points, 2] and z-depths [views, points] of world points [points, 3]."""
        local = np.einsum("vji,vpj->vpi", self.axes, points[None] - self.centre[:, None])
        depth = local[..., 2]
        safe = np.where(np.abs(depth) > 1e-12, depth, 1e-12)
        return local[..., :2] / safe[..., None] * self.focal[:, None] + self.principal[:, None], depth

    @property
    def looked_at(self) -> Array:
        """The world point nearest to all optical axes, by least squares."""
        forward = self.axes[:, :, 2]
        projector = np.eye(3) - forward[:, :, None] * forward[:, None, :]
        right = np.einsum("vij,vj->i", projector, self.centre)
        return np.linalg.lstsq(projector.sum(0), right, rcond=None)[0]


FIELDS = ("axes", "centre", "focal", "principal", "size")


def stacked(cameras: Sequence[Camera]) -> Cameras:
    """The cameras of views as arrays."""
    return Cameras(
        np.stack([each.axes.double().numpy() for each in cameras]),
        np.stack([each.centre.double().numpy() for each in cameras]),
        np.array([[each.fx, each.fy] for each in cameras], dtype=float),
        np.array([[each.cx, each.cy] for each in cameras], dtype=float),
        np.array([[each.width, each.height] for each in cameras], dtype=float),
    )


Change = Callable[[Cameras], Cameras]


@dataclass(frozen=True)
class Alternative:
    """Another reading of cameras: what it says of the file, and the cameras under it.

    ``of_world``: whether it turns or mirrors the world, so that only views of which some have it differ.
    """

    says: str
    change: Change
    of_world: bool = False


def _image(flip_x: bool, flip_y: bool, cameras: Cameras) -> Cameras:
    """The stored images are mirrored: left to right, upside down, or both."""
    sign = np.array([-1.0 if flip_x else 1.0, -1.0 if flip_y else 1.0])
    principal = np.where(sign < 0, cameras.size - cameras.principal, cameras.principal)
    return replace(cameras, axes=cameras.axes * np.append(sign, 1.0), principal=principal)


def _transposed_image(cameras: Cameras) -> Cameras:
    """Rows and columns of the stored images are exchanged; for square images."""
    swap = [1, 0]
    return replace(
        cameras, axes=cameras.axes[:, :, [1, 0, 2]], focal=cameras.focal[:, swap],
        principal=cameras.principal[:, swap], size=cameras.size[:, swap],
    )  # fmt: skip


def _quarter(flip_x: bool, cameras: Cameras) -> Cameras:
    return _image(flip_x, not flip_x, _transposed_image(cameras))


def _axes(signs: tuple[float, float, float], cameras: Cameras) -> Cameras:
    return replace(cameras, axes=cameras.axes * np.array(signs))


def _transposed(signs: Array, cameras: Cameras) -> Cameras:
    """The transpose was taken before axes with other ``signs`` were read as OpenCV's."""
    return replace(cameras, axes=(cameras.axes * signs).transpose(0, 2, 1) * signs)


def _inverted(signs: Array, cameras: Cameras) -> Cameras:
    """World-to-camera was read as camera-to-world."""
    axes = (cameras.axes * signs).transpose(0, 2, 1)
    return replace(cameras, axes=axes * signs, centre=-np.einsum("vij,vj->vi", axes, cameras.centre))


def _world(matrix: Array, what: str, cameras: Cameras) -> Cameras:
    """Positions, rotations or both were written in other axes of the world."""
    axes = cameras.axes if what == "centre" else np.einsum("ij,vjk->vik", matrix, cameras.axes)
    return replace(cameras, axes=axes, centre=cameras.centre if what == "axes" else cameras.centre @ matrix.T)


def _mirrored(matrix: Array, cameras: Cameras) -> Cameras:
    """The pose was mirrored in the world and, to stay a rotation, along the camera's x axis."""
    return _axes((-1.0, 1.0, 1.0), _world(matrix, "both", cameras))


def _nearer(factor: float, cameras: Cameras) -> Cameras:
    """Distances of the cameras from what they look at were scaled."""
    middle = cameras.looked_at if len(cameras) > 2 else np.zeros(3)
    return replace(cameras, centre=middle + (cameras.centre - middle) * factor)


def _zoomed(factors: Array, cameras: Cameras) -> Cameras:
    return replace(cameras, focal=cameras.focal * factors)


def rolled(degrees: float, cameras: Cameras) -> Cameras:
    """Turned about the optical axis, clockwise as seen from behind the camera."""
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return replace(cameras, axes=cameras.axes @ turn)


IMAGES: tuple[Alternative, ...] = (
    Alternative("the image mirrored left to right", partial(_image, True, False)),
    Alternative("the image upside down (top and bottom exchanged)", partial(_image, False, True)),
    Alternative("the image turned by 180 degrees", partial(_image, True, True)),
)
SQUARE_IMAGES: tuple[Alternative, ...] = (
    Alternative("the image turned by 90 degrees", partial(_quarter, True)),
    Alternative("the image turned by 90 degrees the other way", partial(_quarter, False)),
    Alternative("the image with rows and columns exchanged", _transposed_image),
)


OPENGL, OPENCV = np.array([1.0, -1.0, -1.0]), np.ones(3)
"""Signs of a camera's axes beside OpenCV's."""

MIRRORS = {"x": np.diag([-1.0, 1, 1]), "y": np.diag([1.0, -1, 1]), "z": np.diag([1.0, 1, -1])}
Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])

POSES: tuple[Alternative, ...] = (
    Alternative("OpenGL axes where OpenCV's were read, or the reverse (y and z negated)",
                partial(_axes, (1.0, -1.0, -1.0))),
    Alternative("the rotation transposed", partial(_transposed, OPENGL)),
    Alternative("the rotation transposed (OpenCV axes)", partial(_transposed, OPENCV)),
    Alternative("the pose inverted (world-to-camera where camera-to-world is expected)", partial(_inverted, OPENGL)),
    Alternative("the pose inverted (OpenCV axes)", partial(_inverted, OPENCV)),
    Alternative("the camera's x axis negated (handedness)", partial(_axes, (-1.0, 1.0, 1.0))),
    Alternative("the camera's y axis negated (handedness)", partial(_axes, (1.0, -1.0, 1.0))),
    Alternative("the camera's z axis negated (handedness)", partial(_axes, (1.0, 1.0, -1.0))),
    Alternative("the camera's x and z axes negated", partial(_axes, (-1.0, 1.0, -1.0))),
    *(Alternative(f"the pose mirrored in the world's {name}", partial(_world, matrix, "both"), True)
      for name, matrix in MIRRORS.items()),
    *(Alternative(f"the pose mirrored in the world's {name} as a rotation", partial(_mirrored, matrix), True)
      for name, matrix in MIRRORS.items()),
    *(Alternative(f"the position mirrored in the world's {name}", partial(_world, matrix, "centre"))
      for name, matrix in MIRRORS.items()),
    Alternative("the position negated", partial(_world, -np.eye(3), "centre")),
    *(
        Alternative(f"{what} in a world with {up} up", partial(_world, matrix, part), part == "both")
        for what, part in (("the pose", "both"), ("the position alone", "centre"), ("the rotation alone", "axes"))
        for up, matrix in (("Y", Y_UP), ("-Y", Y_UP.T))
    ),
)  # fmt: skip

FACTORS = (0.5, 0.67, 0.75, 0.8, 0.85, 0.9, 0.95, 1.05, 1.1, 1.15, 1.2, 1.25, 1.33, 1.5, 2.0)

LENSES: tuple[Alternative, ...] = tuple(
    Alternative(f"a {name} {factor:g} times the recorded one", partial(_zoomed, np.where(which, factor, 1.0)))
    for name, which in (
        ("focal length", (True, True)), ("horizontal focal length", (True, False)),
        ("vertical focal length", (False, True)),
    )
    for factor in FACTORS
)  # fmt: skip

DISTANCES: tuple[Alternative, ...] = tuple(
    Alternative(f"the distance from the world's middle {factor:g} times the recorded one", partial(_nearer, factor))
    for factor in FACTORS
)

ROLLS: tuple[Alternative, ...] = tuple(
    Alternative(f"the camera turned by {degrees} degrees about its optical axis", partial(rolled, degrees))
    for degrees in (*range(-45, 0, 5), *range(5, 50, 5), -120, -90, -60, 60, 90, 120, 180, -3, 3)
)


def alternatives(cameras: Cameras, whole: bool) -> Iterator[Alternative]:
    """Readings to try, those of one view or (``whole``) of all views at once, where a world turned or mirrored as a
    whole is the same scene."""
    yield from IMAGES
    if bool((cameras.size[:, 0] == cameras.size[:, 1]).all()):
        yield from SQUARE_IMAGES
    yield from (each for each in POSES if not (whole and each.of_world))
    yield from LENSES
    if not whole:
        yield from DISTANCES
    yield from ROLLS


Cost = Callable[[Cameras], float]


class Fit(NamedTuple):
    """Another reading of cameras or values, and how badly it fits."""

    says: str
    cost: float


def best(tried: Iterable[tuple[str, float]]) -> Fit:
    """The reading with the least cost, the first one of equal ones; an infinite cost where none was tried."""
    return min((Fit(*each) for each in tried), key=lambda fit: fit.cost, default=Fit("", np.inf))


def best_reading(own: Cameras, cost: Cost, others: Sequence[tuple[str, Cameras]] | None = None) -> Fit:
    """The alternative with the least cost; the first one of those that are nearly as good (within 15 %).

    ``others``: names and cameras of other views, which may belong to a single view's image; None for the cameras of
    all views at once.
    """
    tried = [Fit(each.says, cost(each.change(own))) for each in alternatives(own, whole=others is None)]
    tried += [Fit(f"the camera of {name}", cost(camera)) for name, camera in others or ()]
    tried.append(_best_shift(own, cost))
    least = min(each.cost for each in tried)
    return next(each for each in tried if each.cost <= 1.15 * least)


def _best_shift(own: Cameras, cost: Cost) -> Fit:
    """The shift of the principal point that fits best, by a search on ever finer grids."""
    shift, left = np.zeros(2), cost(own)
    step = 0.08 * float(own.size.max())
    for _ in range(6):
        around = [shift + step * np.array([x, y]) for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y]
        results = [cost(replace(own, principal=own.principal + pixels)) for pixels in around]
        place = int(np.argmin(results))
        if results[place] < left:
            shift, left = around[place], results[place]
        else:
            step /= 2
    across, down = (100 * float(value) for value in shift / own.size.max())
    return Fit(f"the principal point (or the image) moved by ({across:+.1f} %, {down:+.1f} %) of its side", left)
