"""The lens that the fields of a ``transforms*.json`` describe, of the whole file or of one frame.

Either one angle of view, or focal lengths and a principal point in pixels; with the distortion that instant-ngp and
nerfstudio write (k1, k2, k3, p1, p2 as OpenCV has them; k1 to k4 of its fisheye model).
"""

import math
from collections.abc import Callable, Mapping
from typing import Any

from radiogs_core.errors import DataError

from .lens import LARGEST_COEFFICIENT, LENS, ORDER, PARAMETERS, Lens, Projection, coefficients_of

SIZE = ("w", "h")
PIXELS = ("fl_x", "fl_y", "cx", "cy")
COEFFICIENTS = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
FIELDS = frozenset(
    {*SIZE, *PIXELS, *COEFFICIENTS, "camera_angle_x", "camera_angle_y", "camera_model", "is_fisheye"}
)  # fmt: skip
"""Fields of a lens: those of a frame take the place of the file's."""

OTHER_LENSES = ("ftheta_p0", "ftheta_p1", "latlong", "equirectangular", "rolling_shutter")
"""instant-ngp's fields for cameras that OpenCV cannot undistort."""

COMMON = frozenset({"k1", "k2", "k3", "p1", "p2"})
"""Coefficients that all codes mean alike: k4 is a power of r for nerfstudio, and a divisor's for OpenCV."""

LensOfSize = Callable[[int, int], Lens]
"""The lens for an image of so many rows and columns; raises DataError for a size that it does not know."""


def lens_of_fields(what: str, fields: Mapping[str, Any]) -> LensOfSize:
    """The lens of a file or frame; ``what`` names it in errors. Raises DataError."""
    refused = [name for name in OTHER_LENSES if _is_set(fields.get(name))]
    if refused:
        raise DataError(
            f"{what}: its lens has '{refused[0]}'", "OpenCV has no formula for it.", "Undistort the images first."
        )
    projection, coefficients = _distortion(what, fields)
    if "fl_x" in fields:
        return _of_pixels(what, fields, projection, coefficients)
    return _of_angle(what, fields, projection, coefficients)


def finite(value: object) -> float:
    """A number of a JSON file as a float; NaN for what is none, or too large for one."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan


def _of_angle(what: str, fields: Mapping[str, Any], projection: Projection, bent: tuple[float, ...]) -> LensOfSize:
    """Square pixels and a principal point in the middle, of a horizontal field of view in radians."""
    angle = fields.get("camera_angle_x")
    if not 0 < finite(angle) < math.pi:
        raise DataError(
            f"{what}: 'camera_angle_x' is {angle!r:.40}",
            "It must be the horizontal field of view in radians, between 0 and pi; the focal length follows from it.",
            "Correct the file.",
        )
    ratio = 0.5 / math.tan(0.5 * finite(angle))

    def lens(height: int, width: int) -> Lens:
        return Lens(ratio * width, ratio * width, width / 2, height / 2, width, height, projection, bent)

    return lens


def _of_pixels(what: str, fields: Mapping[str, Any], projection: Projection, bent: tuple[float, ...]) -> LensOfSize:
    """Pixels of an image of one size; images of another size are refused, not guessed at."""
    given = {"fl_y": fields["fl_x"], **fields}
    names = (*PIXELS, *SIZE)
    fx, fy, cx, cy, width, height = (finite(given.get(name)) for name in names)
    try:
        if width != width // 1 or height != height // 1:
            raise ValueError("sizes are whole numbers of pixels")
        stored = Lens(fx, fy, cx, cy, int(width), int(height), projection, bent)
    except (ValueError, OverflowError) as error:
        raise DataError(
            f"{what}: {', '.join(names)} are {[given.get(name) for name in names]!r:.160}",
            f"They must be finite numbers: {error}.",
            "Correct the file.",
        ) from error

    def lens(rows: int, columns: int) -> Lens:
        if (stored.height, stored.width) != (rows, columns):
            raise DataError(
                f"{what} is written for images of {stored.width} x {stored.height} pixels, one is {columns} x {rows}",
                "Its focal lengths count those pixels.",
                "Use the images that the file was made for.",
            )
        return stored

    return lens


def _distortion(what: str, fields: Mapping[str, Any]) -> tuple[Projection, tuple[float, ...]]:
    """The projection and OpenCV's coefficients. Raises DataError for what is no number, or not of the model."""
    named = {name: finite(fields[name]) for name in COEFFICIENTS if fields.get(name) is not None}
    broken = [name for name, value in named.items() if not math.isfinite(value)]
    if broken:
        raise DataError(
            f"{what}: '{broken[0]}' is {fields[broken[0]]!r:.40}",
            "A coefficient of distortion is a finite number.",
            "Correct the file.",
        )
    model = fields.get("camera_model", "OPENCV_FISHEYE" if _is_set(fields.get("is_fisheye")) else None)
    if model is not None and (not isinstance(model, str) or model not in PARAMETERS):
        raise DataError(
            f"{what}: 'camera_model' is {model!r:.40}",
            f"Undistorted on reading are: {', '.join(PARAMETERS)}.",
            "Undistort the images first.",
        )
    known = COMMON if model in (None, "OPENCV") else frozenset(PARAMETERS[model]) - {*LENS, "f"}
    foreign = [name for name, value in named.items() if value and name not in known]
    if foreign:
        raise DataError(
            f"{what}: '{foreign[0]}' is {named[foreign[0]]:g}, which model {model or 'OPENCV'} does not have",
            "Codes differ in what it means.",
            "Name the lens by 'camera_model' (FULL_OPENCV has k1 to k6), or undistort the images first.",
        )
    projection: Projection = "fisheye" if model is not None and model.endswith("FISHEYE") else "perspective"
    bent = coefficients_of(projection, {name: value for name, value in named.items() if name in ORDER[projection]})
    if any(abs(value) > LARGEST_COEFFICIENT for value in bent):
        raise DataError(
            f"{what}: a coefficient of distortion is beyond {LARGEST_COEFFICIENT:g}",
            "No lens has it.",
            "Correct the file.",
        )
    return projection, bent


def _is_set(value: object) -> bool:
    """Whether a field says anything but nothing, zero and false; lists of zeros say nothing."""
    return any(map(_is_set, value)) if isinstance(value, list) else bool(value)
