"""A photo's lens: focal lengths, principal point, and OpenCV's two models of distortion."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeVar

from radiogs_core.scene.camera import Camera

Projection = Literal["perspective", "fisheye"]

ORDER: Mapping[Projection, tuple[str, ...]] = {
    "perspective": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "fisheye": ("k1", "k2", "k3", "k4"),
}
"""Coefficients of both models in the order in which OpenCV takes them."""

COEFFICIENTS = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")

LENS = ("fx", "fy", "cx", "cy")

PARAMETERS: Mapping[str, tuple[str, ...]] = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": LENS,
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": (*LENS, "k1", "k2", "p1", "p2"),
    "OPENCV_FISHEYE": (*LENS, "k1", "k2", "k3", "k4"),
    "FULL_OPENCV": (*LENS, "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "SIMPLE_FISHEYE": ("f", "cx", "cy"),
    "FISHEYE": LENS,
    "SIMPLE_RADIAL_FISHEYE": ("f", "cx", "cy", "k1"),
    "RADIAL_FISHEYE": ("f", "cx", "cy", "k1", "k2"),
}
"""COLMAP's camera models that OpenCV can undistort; parameters in COLMAP's order (its ``sensor/models.h``)."""

LARGEST_COEFFICIENT = 1e6
"""Coefficients above this value are taken for damage: real lenses have coefficients below a hundred."""


@dataclass(frozen=True)
class Lens:
    """How a point at (x, y, z) of the camera (OpenCV axes) reaches a pixel of an image of ``width`` x ``height``.

    Focal lengths and principal point are in pixels, whose centres lie at +0.5. ``coefficients`` are those of OpenCV's
    model, in its order, for normalised coordinates (x / z, y / z): "perspective" is its polynomial or rational model
    with tangential terms, "fisheye" its equidistant one. Raises ValueError for impossible values.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    projection: Projection = "perspective"
    coefficients: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not all(math.isfinite(value) and value > 0 for value in (self.fx, self.fy, self.width, self.height)):
            raise ValueError("focal lengths and sizes must be finite and above zero")
        if not (math.isfinite(self.cx) and math.isfinite(self.cy)):
            raise ValueError("the principal point must be finite")
        if not all(abs(value) <= LARGEST_COEFFICIENT for value in self.coefficients):
            raise ValueError(f"coefficients of distortion must be finite and at most {LARGEST_COEFFICIENT:g}")

    @property
    def size(self) -> tuple[int, int]:
        """Height and width."""
        return self.height, self.width

    @property
    def pinhole(self) -> bool:
        """Whether it leaves straight lines straight."""
        return self.projection == "perspective" and not any(self.coefficients)

    @property
    def bend(self) -> float:
        """Share of its distance from the principal point by which distortion moves the image's farthest corner."""
        across = max(abs(self.cx), abs(self.width - self.cx)) / self.fx
        down = max(abs(self.cy), abs(self.height - self.cy)) / self.fy
        named = dict.fromkeys(COEFFICIENTS, 0.0) | dict(zip(ORDER[self.projection], self.coefficients, strict=False))
        square = across**2 + down**2
        radial = 1 + sum(named[f"k{power}"] * square**power for power in (1, 2, 3))
        if self.projection == "fisheye":
            radial += named["k4"] * square**4
        else:
            divisor = 1 + sum(named[f"k{power + 3}"] * square**power for power in (1, 2, 3))
            radial = radial / divisor if divisor else math.inf
        return abs(radial - 1) + 3 * max(abs(named["p1"]), abs(named["p2"])) * math.sqrt(square)

    @property
    def oblong(self) -> float:
        """Ratio of the longer to the shorter side of its pixels, from the focal lengths."""
        return max(self.fx, self.fy) / min(self.fx, self.fy)


Sized = TypeVar("Sized", Lens, Camera)


def at_size(given: Sized, height: int, width: int) -> Sized:
    """The same lens or view in another number of pixels; distortion acts before pixels and stays."""
    across, along = width / given.width, height / given.height
    return replace(
        given, fx=given.fx * across, fy=given.fy * along, cx=given.cx * across, cy=given.cy * along,
        width=width, height=height,
    )  # fmt: skip


SIZE_TOLERANCE = 1.0
"""Pixels by which a reduced image's sides may deviate from the whole image's proportions: sizes are rounded."""


def is_reduction(size: tuple[int, ...], whole: tuple[int, ...]) -> bool:
    """Whether an image of ``size`` (height, width) has the proportions of the ``whole`` one, and is no larger."""
    scale = size[1] / whole[1]
    return max(scale, size[0] / whole[0]) <= 1 and abs(whole[0] * scale - size[0]) <= SIZE_TOLERANCE


def lens_of(model: str, parameters: Sequence[float], width: int, height: int) -> Lens:
    """The lens of one of COLMAP's camera models. Raises KeyError for one not in PARAMETERS, ValueError for bad values.

    ``parameters`` are in COLMAP's order; pixel centres lie at +0.5 there, too.
    """
    names = PARAMETERS[model]
    if len(parameters) != len(names):
        raise ValueError(f"{model} has {len(names)} parameters, not {len(parameters)}")
    given = dict(zip(names, parameters, strict=True))
    projection: Projection = "fisheye" if model.endswith("FISHEYE") else "perspective"
    fx, fy = (given["f"], given["f"]) if "f" in given else (given["fx"], given["fy"])
    return Lens(fx, fy, given["cx"], given["cy"], width, height, projection, coefficients_of(projection, given))


def coefficients_of(projection: Projection, named: Mapping[str, float]) -> tuple[float, ...]:
    """Coefficients by name, in OpenCV's order; missing ones are zero."""
    return tuple(float(named.get(name, 0.0)) for name in ORDER[projection])
