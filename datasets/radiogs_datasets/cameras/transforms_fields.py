"""The fields of a ``transforms*.json``: the lens that they describe, and the handling of unknown fields.

A lens, for the whole file or for one frame, is either one angle of view, or focal lengths and a principal point in
pixels; with the distortion that instant-ngp and nerfstudio write (k1, k2, k3, p1, p2 as OpenCV has them; k1 to k4 of
its fisheye model).

A field that is not read could still change the image: a lens, a crop, a mirrored axis. So fields known to do this are
refused by name when set; fields known to be harmless are skipped; any other is listed among the scene's repairs.
"""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from radiogs_core.errors import DataError

from .lens import (
    COEFFICIENTS,
    LARGEST_COEFFICIENT,
    LENS,
    ORDER,
    PARAMETERS,
    Lens,
    Projection,
    at_size,
    coefficients_of,
    is_reduction,
)

SIZE = ("w", "h")
PIXELS = ("fl_x", "fl_y", "cx", "cy")
OTHER_LENSES = ("ftheta_p0", "ftheta_p1", "latlong", "equirectangular", "orthographic", "rolling_shutter")
"""instant-ngp's fields for cameras that cannot be made a pinhole."""

ANGLES = ("camera_angle_x", "camera_angle_y", "fovx", "fovy")
"""Angles of view: in radians, and as instant-ngp's script writes them for each of several cameras, in degrees."""

FIELDS = frozenset({*SIZE, *PIXELS, *COEFFICIENTS, *OTHER_LENSES, *ANGLES, "camera_model", "is_fisheye"})
"""Fields of a lens; a frame's fields override the file's."""

OTHER_NAMES = {"fx": "fl_x", "fy": "fl_y", "c_x": "cx", "c_y": "cy", "width": "w", "height": "h"}
"""Names that other codes give to fields of a lens."""

COMMON = frozenset({"k1", "k2", "k3", "p1", "p2"})
"""Coefficients that all codes mean alike: k4 is a power of r for nerfstudio, and a divisor's for OpenCV."""

SAME_FOCAL = 1e-3
"""Share by which focal lengths of both angles of view may differ in square pixels: angles are rounded."""

OTHER_FOCAL = 0.02
"""Share by which angles of view may contradict focal lengths: some writers ignore distortion, or round the size."""

LensOfSize = Callable[[int, int], Lens]
"""The lens for an image of so many rows and columns; raises DataError for an inconsistent size."""

Note = Callable[[str], object]
"""Receives a sentence on a value that was read otherwise than it is written."""


def wrong_field(what: str, name: str, value: object, why: str, remedy: str = "Correct the file.") -> DataError:
    """The error for a value that a field cannot have; ``what`` names its file or frame."""
    return DataError(f"{what}: '{name}' is {value!r:.40}", why, remedy)


def with_known_names(fields: Mapping[str, Any], note: Note) -> dict[str, Any]:
    """The fields renamed to the names of instant-ngp and nerfstudio (``OTHER_NAMES``)."""
    renamed = {name: ours for name, ours in OTHER_NAMES.items() if name in fields and ours not in fields}
    if renamed:
        note(f"{', '.join(renamed)} are read as {', '.join(renamed.values())}")
    # A second name that says the same says nothing new; another value is left, and refused as an unknown field.
    same = {name for name, ours in OTHER_NAMES.items() if name in fields and fields[name] == fields.get(ours)}
    return {renamed.get(name, name): value for name, value in fields.items() if name not in same}


def lens_of_fields(what: str, fields: Mapping[str, Any], note: Note) -> LensOfSize:
    """The lens of a file or frame; ``what``: its name in errors, ``note`` receives assumptions. Raises DataError."""
    refused = [name for name in OTHER_LENSES if is_set(fields.get(name))]
    if refused:
        raise DataError(
            f"{what}: its lens has '{refused[0]}'",
            "Images of such a camera are not those of a pinhole, and OpenCV has no formula for it.",
            "Render or undistort the images as a pinhole would see them.",
        )
    projection, coefficients = _distortion(what, fields)
    if "fl_x" in fields:
        return _of_pixels(what, fields, projection, coefficients, note)
    if "fl_y" in fields:
        raise DataError(f"{what}: there is 'fl_y' without 'fl_x'", "Focal lengths come in pairs.", "Correct the file.")
    return _of_angle(what, _in_radians(what, fields), projection, coefficients)


def finite(value: object) -> float:
    """A number of a JSON file as a float; NaN for any other value, or a number too large for a float."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan


def _in_radians(what: str, fields: Mapping[str, Any]) -> Mapping[str, Any]:
    """The fields with angles in degrees converted to radians. Raises DataError if the unit is ambiguous."""
    if fields.get("camera_angle_x") is not None or not any(is_set(fields.get(name)) for name in ANGLES[2:]):
        return fields
    angles = {}
    for name, ours in zip(ANGLES[2:], ANGLES[:2], strict=True):
        if (value := fields.get(name)) is not None:
            if not math.pi < finite(value) < 180:
                why = "Degrees are between 3.15 and 180; whether a smaller number means radians cannot be told."
                raise wrong_field(what, name, value, why, f"Write '{ours}', in radians.")
            angles[ours] = math.radians(finite(value))
    return {**fields, **angles}


def _of_angle(what: str, fields: Mapping[str, Any], projection: Projection, bent: tuple[float, ...]) -> LensOfSize:
    """The lens with a horizontal field of view in radians, for images of any size.

    Pixels are square unless there is a vertical field of view. The principal point is the image's centre unless the
    file gives it for a size."""
    across = _ratio(what, "camera_angle_x", fields.get("camera_angle_x"))
    vertical = fields.get("camera_angle_y")
    down = None if vertical is None else _ratio(what, "camera_angle_y", vertical)
    given = {name: finite(fields[name]) for name in (*PIXELS[2:], *SIZE) if fields.get(name) is not None}
    if not all(map(math.isfinite, given.values())):
        raise DataError(f"{what}: of {', '.join(given)} one is no finite number", "", "Correct the file.")

    def lens(height: int, width: int) -> Lens:
        columns, rows = given.get("w", float(width)), given.get("h", float(height))
        if min(columns, rows) <= 0 or abs(columns * height - rows * width) > max(columns, rows, height, width):
            raise _other_size(what, (columns, rows), (width, height))
        cx, cy = given.get("cx", columns / 2) * width / columns, given.get("cy", rows / 2) * height / rows
        fx = across * width
        fy = fx if down is None or abs(down * height - fx) <= SAME_FOCAL * fx else down * height
        return Lens(fx, fy, cx, cy, width, height, projection, bent)

    return lens


def _ratio(what: str, name: str, angle: object) -> float:
    """Focal length over the side that an angle of view spans."""
    if not 0 < finite(angle) < math.pi:
        why = "It must be a field of view in radians, between 0 and pi; the focal length follows from it."
        raise wrong_field(what, name, angle, why)
    return 0.5 / math.tan(0.5 * finite(angle))


def _other_size(what: str, written: tuple[float, float], found: tuple[int, int]) -> DataError:
    return DataError(
        f"{what} is written for images of {written[0]:g} x {written[1]:g} pixels, one is {found[0]} x {found[1]}",
        "Its focal lengths count those pixels.",
        "Use the images that the file was made for.",
    )


def _of_pixels(
    what: str, fields: Mapping[str, Any], projection: Projection, bent: tuple[float, ...], note: Note
) -> LensOfSize:
    """The lens in pixels of an image of one size, or of the images' size if none is given.

    A reduced image gets a scaled lens; an image of other proportions, or a larger one, is refused.
    """
    given = {name: finite(fields[name]) for name in (*PIXELS, *SIZE) if fields.get(name) is not None}
    given.setdefault("fl_y", given.get("fl_x", math.nan))
    _require_pixels(what, fields, given)
    absent = [name for name in PIXELS[2:] if name not in given]
    if absent:
        note(f"{' and '.join(absent)} missing: the principal point is taken for the image's centre")
    if not given.keys() >= {*SIZE}:
        note("w or h missing: focal lengths are taken for pixels of the images as they are")

    def lens(rows: int, columns: int) -> Lens:
        width, height = int(given.get("w", columns)), int(given.get("h", rows))
        if not is_reduction((rows, columns), (height, width)):
            raise _other_size(what, (width, height), (columns, rows))
        cx, cy = given.get("cx", width / 2), given.get("cy", height / 2)
        whole = Lens(given["fl_x"], given["fl_y"], cx, cy, width, height, projection, bent)
        return whole if (height, width) == (rows, columns) else at_size(whole, rows, columns)

    if given.keys() >= {*SIZE}:
        for sentence in _other_angles(fields, lens(int(given["h"]), int(given["w"]))):
            note(sentence)
    return lens


def _require_pixels(what: str, fields: Mapping[str, Any], given: Mapping[str, float]) -> None:
    """Raise DataError for impossible focal lengths, principal points and sizes."""
    try:
        if not all(math.isfinite(value) for value in given.values()):
            raise ValueError("one is none")
        if any(given[name] != given[name] // 1 for name in SIZE if name in given):
            raise ValueError("sizes are whole numbers of pixels")
        width, height = (int(given.get(name, 1)) for name in SIZE)
        Lens(given["fl_x"], given["fl_y"], given.get("cx", 0.0), given.get("cy", 0.0), width, height)
    except ValueError as error:
        names = (*PIXELS, *SIZE)
        raise DataError(
            f"{what}: {', '.join(names)} are {[fields.get(name) for name in names]!r:.160}",
            f"They must be finite numbers: {error}.",
            "Correct the file.",
        ) from error


def _other_angles(fields: Mapping[str, Any], stored: Lens) -> Iterator[str]:
    """A sentence for each angle of view that contradicts the focal length beside it, which is used."""
    sides = ((stored.fx, stored.width), (stored.fy, stored.height)) * 2
    for name, (focal, side), field in zip(ANGLES, sides, PIXELS[:2] * 2, strict=True):
        if not is_set(fields.get(name)):
            continue
        angle = finite(fields[name])
        units = (1.0,) if name.startswith("camera") else (math.pi / 180, 1.0)
        possible = [angle * unit for unit in units if 0 < angle * unit < math.pi]
        focals = [0.5 * side / math.tan(0.5 * each) for each in possible]
        if not any(abs(each - focal) <= OTHER_FOCAL * focal for each in focals):
            makes = f" (a focal length of {focals[0]:.5g})" if focals else ""
            yield f"{name} is {fields[name]!r:.20}{makes}, and {field} {focal:.5g}: {field} is taken"


def _distortion(what: str, fields: Mapping[str, Any]) -> tuple[Projection, tuple[float, ...]]:
    """The projection and OpenCV's coefficients. Raises DataError for text, or coefficients of another model."""
    named = {name: finite(fields[name]) for name in COEFFICIENTS if fields.get(name) is not None}
    broken = [name for name, value in named.items() if not math.isfinite(value)]
    if broken:
        raise wrong_field(what, broken[0], fields[broken[0]], "A coefficient of distortion is a finite number.")
    model = fields.get("camera_model", "OPENCV_FISHEYE" if is_set(fields.get("is_fisheye")) else None)
    if model is not None and (not isinstance(model, str) or model not in PARAMETERS):
        why = f"Undistorted on reading are: {', '.join(PARAMETERS)}."
        raise wrong_field(what, "camera_model", model, why, "Undistort the images first.")
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


def is_set(value: object) -> bool:
    """Whether a field has a value other than null, zero, false, empty or lists of zeros."""
    return any(map(is_set, value)) if isinstance(value, list) else bool(value)


READ = FIELDS | {
    "frames", "file_path", "transform_matrix", "mask_path", "depth_file_path", "depth_path", "applied_transform",
    "integer_depth_scale", "depth_unit_scale_factor", "ply_file_path", "train_filenames", "val_filenames",
    "test_filenames", "scene_name", "masks",
}  # fmt: skip
"""Fields that are applied, or refused where the lens is read."""

HARMLESS = frozenset({
    "aabb", "aabb_scale", "render_aabb", "scale", "offset", "from_na", "up", "n_frames", "n_extra_learnable_dims",
    "enable_depth_loading", "enable_ray_loading", "applied_scale", "orientation_override", "auto_scale_poses_factor",
    "sharpness", "rotation", "colmap_im_id", "colmap_id", "driver_parameters", "near", "far", "id", "index", "name",
})  # fmt: skip
"""How other programs frame the scene, choose photos, or made them: NeRF-synthetic's ``rotation`` turned its camera from
one frame to the next, instant-ngp's ``scale`` and ``offset`` place the scene in its own unit cube, nerfstudio's
``applied_scale`` is in the poses already."""

HARMLESS_NAMES = re.compile(
    r"(exif|gps|meta_?data|comment|note|author|copyright|licen[cs]e|software|generator|version|source|url|tag|score|date"
    r"|original_(file|path|name))(_?\w*)"
    r"|(\w+_)?(time_?stamp|capture_?time|date_?time|unix_?time)s?(_\w+)?"
    r"|(camera|cam|lens|image|img|frame|view|photo|colmap|sensor)_?(\w+_)?(id|ids|idx|index|name|label|number|num|count|make"
    r"|maker|serial|uid|uuid|im_id|vendor|brand)"
    r"|\w+_(id|ids|idx|uid|uuid|label)|(motion_)?blur(riness|_score)?|iso|aperture|f_?number|serial(_number)?",
    re.IGNORECASE,
)
"""Names of fields on a photo's origin or name, which do not affect the image."""

SAME_CONVENTION = frozenset({"opengl", "blender", "nerf", "nerfstudio", "instant-ngp", "ngp"})
"""Values of fields on conventions that agree with how files are read: OpenGL's camera-to-world."""

CONVENTION = re.compile(r".*(convention|coordinate_?(system|frame)).*", re.IGNORECASE)

CHANGES_IMAGES = re.compile(
    r"(?!.*(velocit|accelerat)|exposure_time$)"
    r"((k|p|s|b)\d+|.*(distort|fisheye|fov|focal|principal|skew|shear|crop|shutter|lens|intrinsic|camera|extrinsic"
    r"|flip|mirror|rotat|orient|convention|coordinate|axis|axes|gamma|exposure|white|colou?r|tonemap|premult|linear"
    r"|transparent|mask|sharpen|pixel_aspect|downscale|resolution|hdr|time|light|matrix|transform|translation|pose).*)",
    re.IGNORECASE,
)
"""Names of fields on how an image was made or cut out; ``time`` and ``light`` mean another scene.

Speed of the camera and exposure time are left out: they do not describe the image."""


def said_of_fields(what: str, table: Mapping[str, Any], frames: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """A sentence on fields that are not known and not read. Raises DataError for fields that could change an image.

    ``what`` names the file. A field that has the same empty value (null, false, zero, empty) in all frames is ignored.
    """
    pairs = [(name, value) for holder in (table, *frames) for name, value in holder.items() if is_set(value)]
    # A field that states the usual convention in words is as good as none.
    names = dict.fromkeys(
        name
        for name, value in pairs
        if not (CONVENTION.fullmatch(name) and str(value).strip().lower() in SAME_CONVENTION)
    )
    unknown = [name for name in names if name not in READ | HARMLESS and not HARMLESS_NAMES.fullmatch(name)]
    refused = sorted(name for name in unknown if CHANGES_IMAGES.fullmatch(name))
    if refused:
        places = [place for place, frame in enumerate(frames) if refused[0] in frame]
        where = (
            f"{what}: frame {places[0]}" + (f" and {len(places) - 1} more" if places[1:] else "") if places else what
        )
        raise DataError(
            f"{where}: '{refused[0]}' is not read"
            + (f", nor are {', '.join(refused[1:])}"[:200] if refused[1:] else ""),
            "By its name it could change what is seen, or from where.",
            "Apply it to the images or poses; then, or if it does not matter, take the field out of the file.",
        )
    return (f"fields that are not known, and not used: {', '.join(sorted(unknown))}"[:300],) if unknown else ()
