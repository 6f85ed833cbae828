"""Cameras in the ``transforms_*.json`` of NeRF-synthetic and its descendants (instant-ngp, nerfstudio): OpenGL
camera-to-world, a lens for the file or for a frame (``transforms_fields``), paths of images, masks and depth.
"""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.errors import DataError
from radiogs_core.scene.camera import Camera

from ..bounded_reading import read_json
from ..options import Meaning
from .transforms_fields import (
    ANGLES,
    FIELDS,
    PIXELS,
    LensOfSize,
    Note,
    finite,
    lens_of_fields,
    said_of_fields,
    with_known_names,
    wrong_field,
)

SPLITS = ("train_filenames", "val_filenames", "test_filenames")

NO_VIEWS = "It lists the views of a scene, with their cameras."

RIGID_TOLERANCE = 1e-3
"""Largest deviation of R R^T from the identity: matrices are often printed with four digits."""

DEPTH_UNIT = 1e-3
"""World units per level of a depth map if the file does not state it: nerfstudio's millimetres."""


@dataclass(frozen=True)
class Frame:
    """The entry of one view in the file.

    ``camera_to_world`` has OpenCV axes, float32; ``lens``: the lens for an image of (height, width). ``mask_path`` and
    ``depth_path``: as written, or None.
    """

    file_path: str
    camera_to_world: Float[Tensor, "4 4"]
    lens: LensOfSize
    mask_path: str | None = None
    depth_path: str | None = None


@dataclass(frozen=True)
class Transforms:
    """All views of a file, in its order.

    ``depth_unit``: world units of a level of a depth map; ``points_path``: a PLY file of sparse points in the world of
    the poses; ``splits``: lists of images by their fields (``SPLITS``); ``masks``: the meaning of black in masks,
    "object" or "ignore", if the file states it; ``said``: sentences on unused parts of the file.
    """

    frames: tuple[Frame, ...]
    depth_unit: float = DEPTH_UNIT
    points_path: str | None = None
    splits: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    masks: str | None = None
    said: tuple[str, ...] = ()

    def camera(self, frame: Frame, height: int, width: int) -> Camera:
        """The pinhole camera of a frame whose image has this size.

        Raises DataError for a size that contradicts its lens, and for a lens that distorts.
        """
        lens = frame.lens(height, width)
        if not lens.pinhole:
            raise DataError(
                f"the lens of {frame.file_path} distorts",
                "Images of this layout come with maps of their pixels, which are not undistorted.",
                "Undistort the images, or use layout blender.",
            )
        return Camera(frame.camera_to_world, lens.fx, lens.fy, lens.cx, lens.cy, width, height)


def read_transforms(path: Path, content: dict[str, Any] | None = None) -> Transforms:
    """Read and check the file, or ``content`` in its place. Raises DataError that names file, frame and field."""
    notes: list[str] = []
    note = notes.append
    table = read_json(path) if content is None else content
    if not isinstance(table, dict):
        raise DataError(f"{path} must hold an object, not a {type(table).__name__}", NO_VIEWS, "Correct the file.")
    table = with_known_names(table, note)
    frames = table.get("frames")
    if not isinstance(frames, list) or not frames:
        raise DataError(
            f"{path}: 'frames' must be a list with at least one view, not {frames!r:.40}", NO_VIEWS, "Correct the file."
        )
    frames = [with_known_names(frame, note) if isinstance(frame, dict) else frame for frame in frames]
    own = [isinstance(frame, dict) and not FIELDS.isdisjoint(frame) for frame in frames]
    common = None if all(own) else lens_of_fields(str(path), table, note)
    if (applied := table.get("applied_transform")) is not None:
        # nerfstudio's record of how it turned the world: poses and points are turned already, so it is only checked.
        what = f"{path}: 'applied_transform'"
        _rigid(what, applied, "It says how the poses were turned into the world that they are in.")
    frames = _without_scale(frames, note)
    meaning = table.get("masks")
    if meaning not in (None, *get_args(Meaning)):
        why = "It says what black means in masks: nothing is there (object), or the pixel is left out (ignore)."
        raise wrong_field(str(path), "masks", meaning, why, "Write 'object' or 'ignore'.")
    unused = said_of_fields(str(path), table, [frame for frame in frames if isinstance(frame, dict)])
    views = tuple(_frame(path, place, frame, table, common, note) for place, frame in enumerate(frames))
    scale = "integer_depth_scale" if "integer_depth_scale" in table else "depth_unit_scale_factor"
    depth_unit = finite(table.get(scale, DEPTH_UNIT))
    if not (math.isfinite(depth_unit) and depth_unit > 0):
        why = "It is the length of a level of a depth map in world units."
        raise wrong_field(str(path), scale, table[scale], why)
    return Transforms(
        views,
        depth_unit,
        _path(str(path), table, "ply_file_path"),
        {name: names for name in SPLITS if (names := _names(path, table, name))},
        meaning,
        (*unused, *(f"{text} ({count} frames)" if count > 1 else text for text, count in Counter(notes).items())),
    )


def read_splits(folder: Path) -> dict[Path, Transforms]:
    """The files of a scene's training and test views, by their paths. Raises DataError as ``read_transforms``."""
    tables = (folder / f"transforms_{split}.json" for split in ("train", "test"))
    return {table: read_transforms(table) for table in tables}


def said_of_files(files: Mapping[Path, Transforms]) -> tuple[str, ...]:
    """Sentences on the unused parts of each file."""
    return tuple(f"{table.name}: {said}" for table, each in files.items() for said in each.said)


def _without_scale(frames: list[object], note: Note) -> list[object]:
    """The frames with rigid poses, if all rotations (or whole matrices) share one scale factor.

    Such a scale changes neither a camera nor its place, only depths along its rays.
    """
    given = [frame.get("transform_matrix") if isinstance(frame, dict) else None for frame in frames]
    matrices = [_numbers_of(rows) for rows in given]
    if any(matrix is None for matrix in matrices):
        return frames
    poses = torch.stack([matrix for matrix in matrices if matrix is not None])
    last = poses[:, 3, 3]
    if not bool((last > 0).all()) or bool((poses[:, 3, :3] != 0).any()):
        return frames
    poses = poses / last[:, None, None]
    sizes = poses[:, :3, :3].norm(dim=(1, 2)) / 3**0.5
    scale = float(sizes.median())
    off = max(abs(scale - 1), float((last - 1).abs().max()))
    if off <= RIGID_TOLERANCE or not scale > 0 or float((sizes / scale - 1).abs().max()) > RIGID_TOLERANCE:
        return frames
    poses[:, :3, :3] /= scale
    if abs(scale - 1) > RIGID_TOLERANCE:
        note(f"the poses of all frames scale by {scale:.4g}: their rotations are divided by it")
    else:
        note(f"the last number of the poses is {float(last[0]):.4g}: they are divided by it")
    return [{**frame, "transform_matrix": pose.tolist()} for frame, pose in zip(frames, poses, strict=True)]  # type: ignore[dict-item]


def _names(path: Path, table: dict[str, Any], field_name: str) -> tuple[str, ...]:
    names = table.get(field_name)
    if names is None:
        return ()
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise DataError(f"{path}: '{field_name}' must be a list of images", "It names a split.", "Correct the file.")
    return tuple(names)


def _path(what: str, fields: dict[str, Any], *names: str) -> str | None:
    """The first of some fields that exists, as a path."""
    name = next((name for name in names if fields.get(name) is not None), None)
    value = None if name is None else fields[name]
    if value is not None and (not isinstance(value, str) or not value or "\0" in value):
        raise wrong_field(what, str(name), value, "It must be the path of a file.")
    return value


def _frame(
    path: Path, place: int, frame: object, table: dict[str, Any], common: LensOfSize | None, note: Note
) -> Frame:
    name = frame.get("file_path") if isinstance(frame, dict) else None
    if not isinstance(frame, dict) or not isinstance(name, str) or not name or "\0" in name:
        raise DataError(
            f"{path}: frame {place} has no text 'file_path'",
            "It says which image the camera took.",
            "Correct the file.",
        )
    what = f"{path}: frame {place} ({name})"
    lens = common
    if lens is None or not FIELDS.isdisjoint(frame):
        if other := sorted(name for name in FIELDS & table.keys() & frame.keys() if table[name] != frame[name]):
            said = "of a frame and of the file differ: the frame's are taken (nerfstudio takes the file's)"
            note(f"{', '.join(other)} {said}")
        # A frame's angle voids the file's pixels, and the reverse.
        own_angle, own_pixels = "camera_angle_x" in frame and "fl_x" not in frame, "fl_x" in frame
        void = (*PIXELS, *ANGLES[1:]) if own_angle else ANGLES if own_pixels else ()
        merged = {name: value for name, value in table.items() if name not in void} | frame
        lens = lens_of_fields(what, merged, note)
    pose = _rigid(f"{what}: 'transform_matrix'", frame.get("transform_matrix"), "It places the camera in the world.")
    # OpenGL looks along -z with y up; OpenCV looks along z with y down.
    pose[:3, 1:3] *= -1
    mask, depth = _path(what, frame, "mask_path"), _path(what, frame, "depth_file_path", "depth_path")
    return Frame(name, pose.float(), lens, mask, depth)


def _rigid(what: str, rows: object, purpose: str) -> Float[Tensor, "4 4"]:
    """The matrix in float64; ``what`` names its place in errors."""
    matrix = _numbers_of(rows)
    if matrix is None:
        raise DataError(
            f"{what} is not 4 rows of 4 finite numbers", purpose, "Correct the file, or take the view out of it."
        )
    rotation = matrix[:3, :3]
    deviation = float((rotation @ rotation.T - torch.eye(3, dtype=torch.float64)).abs().max())
    told = ""
    if matrix[3].tolist() != [0, 0, 0, 1]:
        transposed = matrix[:3, 3].tolist() == [0, 0, 0] and float(matrix[3, 3]) == 1
        last = " ".join(f"{number:.4g}" for number in matrix[3].tolist())
        told = f"its last row is {last}, not 0 0 0 1{': it is transposed' if transposed else ''}"
    elif deviation > RIGID_TOLERANCE:
        told = f"R R^T is {deviation:.2g} from the identity"
    elif float(torch.linalg.det(rotation)) < 0:
        told = "its determinant is -1: it mirrors the world"
    if told:
        raise DataError(
            f"{what} is not a rigid motion ({told})",
            "A scaled, mirrored or projective camera would bend every normal and depth.",
            "Write camera-to-world by rows, without scale, in right-handed OpenGL axes, with last row 0 0 0 1.",
        )
    return matrix


def _numbers_of(rows: object) -> Float[Tensor, "4 4"] | None:
    """A matrix of four rows of four finite numbers, float64; a last row that is left out is 0 0 0 1."""
    rows = [*rows, [0, 0, 0, 1]] if isinstance(rows, list) and len(rows) == 3 else rows
    if not (isinstance(rows, list) and len(rows) == 4 and all(isinstance(row, list) and len(row) == 4 for row in rows)):
        return None
    numbers = [finite(number) for row in rows for number in row]
    return torch.tensor(numbers, dtype=torch.float64).reshape(4, 4) if all(map(math.isfinite, numbers)) else None
