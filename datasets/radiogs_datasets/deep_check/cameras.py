"""Cameras of many views as arrays, and the likely wrong readings of a camera: conventions, lenses, flipped images.

Reflections of an image are written as cameras with left-handed axes, so that every alternative is a camera.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import product
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

    def take(self, places: Sequence[int] | NDArray[np.int64]) -> "Cameras":
        """The cameras at some places."""
        chosen = np.asarray(places, dtype=np.int64)
        return Cameras(*(getattr(self, name)[chosen] for name in FIELDS))

    def with_one(self, place: int, other: "Cameras") -> "Cameras":
        """A copy whose camera at ``place`` is the single camera of ``other``."""
        parts = ((getattr(self, name), getattr(other, name)) for name in FIELDS)
        return Cameras(*(np.concatenate([own[:place], new, own[place + 1 :]]) for own, new in parts))

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

    @cached_property
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


OPENGL, OPENCV = np.array([1.0, -1.0, -1.0]), np.ones(3)
"""Signs of a camera's axes beside OpenCV's."""

NEGATED = {
    "x axis negated (handedness)": (-1.0, 1.0, 1.0), "y axis negated (handedness)": (1.0, -1.0, 1.0),
    "z axis negated (handedness)": (1.0, 1.0, -1.0), "x and z axes negated": (-1.0, 1.0, -1.0),
}  # fmt: skip
"""Words for wrongly negated axes of a camera, each with the signs."""

MIRRORS = {"x": np.diag([-1.0, 1, 1]), "y": np.diag([1.0, -1, 1]), "z": np.diag([1.0, 1, -1])}
Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])

ROUNDS = 8
"""Steps of a search for an amount: a factor is found to some 0.2 %, a shift to 0.1 % of the side."""

MOVED = 0.5
"""Change of axes, or of position (in distances from the world's origin), from which a camera counts as moved."""

NO_CAUSE = "and no usual mistake explains all of it"
"""The words for a contradiction whose cause is not certain."""


class Family(NamedTuple):
    """Readings of cameras that differ by an amount."""

    says: str
    """Format of its words, with the amount."""
    places: list[int]
    """Index of the amount among the numbers that ``adjusted`` takes."""
    starts: Array
    """[starts, numbers]: initial amounts of the search; it continues around the best one."""
    step: float


FACTORS = np.array([[0.5, 0.67, 0.75, 0.8, 0.85, 0.9, 0.95, 1.05, 1.1, 1.15, 1.2, 1.25, 1.33, 1.5, 2.0]]).T
ROLLS = np.array([[*range(-45, 0, 5), *range(5, 50, 5), -120, -90, -60, 60, 90, 120, 180, -3, 3]], dtype=float).T
SHIFTS = np.array(list(product((-12.0, -6.0, -3.0, 0.0, 3.0, 6.0, 12.0), repeat=2)))
DISTANCE = 2
FAMILIES = (
    Family("a focal length {:.3g} times the recorded one", [0, 1], FACTORS, 0.02),
    Family("a horizontal focal length {:.3g} times the recorded one", [0], FACTORS, 0.02),
    Family("a vertical focal length {:.3g} times the recorded one", [1], FACTORS, 0.02),
    Family("the distance from the world's middle {:.3g} times the recorded one", [DISTANCE], FACTORS, 0.02),
    Family("the camera turned by {:.2g} degrees about its optical axis", [3], ROLLS, 1.0),
    Family("the principal point (or the image) moved by ({:+.1f} %, {:+.1f} %) of its side", [4, 5],
           SHIFTS, 1.5),
)  # fmt: skip


def adjusted(own: Cameras, family: Family, amount: Array) -> Cameras:
    """Cameras with factors on both focal lengths and the distance, a roll in degrees, and a shift in % of the side."""
    numbers = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    numbers[family.places] = amount
    sine, cosine = np.sin(np.radians(numbers[3])), np.cos(np.radians(numbers[3]))
    return replace(
        own, axes=own.axes @ np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]]),
        centre=own.centre * numbers[DISTANCE], focal=own.focal * numbers[:2],
        principal=own.principal + own.size.max() / 100 * numbers[4:],
    )  # fmt: skip


def _images(own: Cameras) -> Iterator[tuple[str, Cameras]]:
    """The stored images are mirrored or turned; by a quarter only where they are square."""
    yield "the image mirrored left to right", _flipped(own, -1.0, 1.0)
    yield "the image upside down (top and bottom exchanged)", _flipped(own, 1.0, -1.0)
    yield "the image turned by 180 degrees", _flipped(own, -1.0, -1.0)
    if bool((own.size[:, 0] == own.size[:, 1]).all()):
        swap = [1, 0]
        transposed = replace(
            own, axes=own.axes[:, :, [1, 0, 2]], focal=own.focal[:, swap],
            principal=own.principal[:, swap], size=own.size[:, swap],
        )  # fmt: skip
        yield "the image turned by 90 degrees", _flipped(transposed, -1.0, 1.0)
        yield "the image turned by 90 degrees the other way", _flipped(transposed, 1.0, -1.0)
        yield "the image with rows and columns exchanged", transposed


def _flipped(own: Cameras, across: float, down: float) -> Cameras:
    sign = np.array([across, down])
    principal = np.where(sign < 0, own.size - own.principal, own.principal)
    return replace(own, axes=own.axes * np.append(sign, 1.0), principal=principal)


def _poses(own: Cameras) -> Iterator[tuple[str, Cameras]]:
    """Rotations and positions were written in another convention of the camera."""
    yield "OpenGL axes where OpenCV's were read, or the reverse (y and z negated)", replace(own, axes=own.axes * OPENGL)
    # Transposes were taken before axes with these signs were read as OpenCV's.
    transposed = [((own.axes * signs).transpose(0, 2, 1), signs) for signs in (OPENGL, OPENCV)]
    for said, (axes, signs) in zip(("", " (OpenCV axes)"), transposed, strict=True):
        yield f"the rotation transposed{said}", replace(own, axes=axes * signs)
    inverted = "world-to-camera where camera-to-world is expected", "OpenCV axes"
    for said, (axes, signs) in zip(inverted, transposed, strict=True):
        centre = -np.einsum("vij,vj->vi", axes, own.centre)
        yield f"the pose inverted ({said})", replace(own, axes=axes * signs, centre=centre)
    for said, negative in NEGATED.items():
        yield f"the camera's {said}", replace(own, axes=own.axes * np.array(negative))


def _worlds(own: Cameras, whole: bool) -> Iterator[tuple[str, Cameras]]:
    """Positions, rotations or both were written in other axes of the world."""

    def read(matrix: Array, part: str) -> Cameras:
        axes = own.axes if part == "centre" else np.einsum("ij,vjk->vik", matrix, own.axes)
        return replace(own, axes=axes, centre=own.centre if part == "axes" else own.centre @ matrix.T)

    if not whole:
        mirrored = {name: read(matrix, "both") for name, matrix in MIRRORS.items()}
        for name, cameras in mirrored.items():
            yield f"the pose mirrored in the world's {name}", cameras
        for name, cameras in mirrored.items():  # to stay a rotation, it was mirrored along the camera's x axis, too
            rotation = replace(cameras, axes=cameras.axes * np.array([-1.0, 1.0, 1.0]))
            yield f"the pose mirrored in the world's {name} as a rotation", rotation
    for name, matrix in MIRRORS.items():
        yield f"the position mirrored in the world's {name}", read(matrix, "centre")
    yield "the position negated", read(-np.eye(3), "centre")
    for what, part in (("the pose", "both"), ("the position alone", "centre"), ("the rotation alone", "axes")):
        for up, matrix in (("Y", Y_UP), ("-Y", Y_UP.T)):
            if not (whole and part == "both"):
                yield f"{what} in a world with {up} up", read(matrix, part)


Cost = Callable[[Cameras], float]


class Fit(NamedTuple):
    """Another reading of cameras or values, and how badly it fits."""

    says: str
    """Words for the reading; empty if it is not a known mistake."""
    cost: float

    def explains(self, what: str, sound: float) -> str:
        """Words for a contradiction, with the reading as its cause if it leaves no more than a ``sound`` part has."""
        named = self.says and self.cost <= sound
        return f"{what}: {self.says} fits far better" if named else f"{what}, {NO_CAUSE}"


def best(tried: Iterable[tuple[str, float]]) -> Fit:
    """The reading with the least cost, the first of equal ones; an infinite cost without any reading."""
    return min((Fit(*each) for each in tried), key=lambda fit: fit.cost, default=Fit("", np.inf))


def best_reading(own: Cameras, cost: Cost, others: Sequence[tuple[str, Cameras]] | None = None) -> tuple[Fit, Cameras]:
    """The reading with the least cost, or the first reading within 15 % of it, and its cameras.

    ``others``: names and cameras of other views, which may belong to a single view's image; None for the cameras of all
    views at once. If another convention hardly moves a single camera, any small error of its pose looks like this
    convention: then the reading has no name.
    """
    whole, recorded, reach = others is None, cost(own), np.linalg.norm(own.centre, axis=1).max()
    tried = []
    for says, other in (*_images(own), *_poses(own), *_worlds(own, whole)):
        moved = max(np.abs(other.centre - own.centre).max() / max(reach, 1e-12), np.abs(other.axes - own.axes).max())
        tried.append((Fit(says if whole or moved > MOVED else "", cost(other)), other))
    tried += [(Fit(f"the camera of {name}", cost(camera)), camera) for name, camera in others or ()]
    # A world that is turned, mirrored or scaled as a whole is the same scene.
    for each in FAMILIES if not whole else [each for each in FAMILIES if each.places != [DISTANCE]]:
        read = partial(adjusted, own, each)
        amount, left = searched(lambda amount: cost(read(amount)), each.starts, each.step, recorded)  # noqa: B023
        tried.append((Fit(each.says.format(*amount), left), read(amount)))
    least = min(fit.cost for fit, _ in tried)
    return next((fit, cameras) for fit, cameras in tried if fit.cost <= 1.15 * least)


def searched(cost: Callable[[Array], float], starts: Array, step: float, worth: float = np.inf) -> tuple[Array, float]:
    """The amount [numbers] of least cost, and the cost: steps from the best start, halved where none is better.

    There is no search around a best start that costs more than ``worth``.
    """
    left, place = min((cost(start), place) for place, start in enumerate(starts))
    amount = starts[place]
    for _ in range(ROUNDS if left <= worth else 0):
        around = [amount + step * np.array(sign) for sign in product((-1, 0, 1), repeat=len(amount)) if any(sign)]
        least, place = min((cost(each), place) for place, each in enumerate(around))
        if least < left:
            amount, left = around[place], least
        else:
            step /= 2
    return amount, left
