"""The fields of ``transforms*.json`` that are known, and what becomes of the others.

A field that is not read could still change what is seen: a lens, a crop, a mirrored axis. So those that do are refused
by name when they are set; those known to be harmless are passed over; any other is listed among the scene's repairs.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from radiogs_core.errors import DataError

from .lenses.fields import FIELDS, is_set

READ = FIELDS | {
    "frames", "file_path", "transform_matrix", "mask_path", "depth_file_path", "depth_path", "applied_transform",
    "integer_depth_scale", "depth_unit_scale_factor", "ply_file_path", "train_filenames", "val_filenames",
    "test_filenames", "scene_name",
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

CHANGES_IMAGES = re.compile(
    r"(k|p|s|b)\d+|.*(distort|fisheye|fov|focal|principal|skew|shear|crop|shutter|lens|intrinsic|camera|extrinsic"
    r"|flip|mirror|rotat|orient|convention|coordinate|axis|axes|gamma|exposure|white|colou?r|tonemap|premult|linear"
    r"|transparent|mask|sharpen|pixel_aspect|downscale|resolution|hdr|time|light|matrix|transform|translation|pose).*",
    re.IGNORECASE,
)
"""Names of fields that say how an image came about, or where from; ``time`` and ``light`` that it is another scene."""


def said_of_fields(what: str, table: Mapping[str, Any], frames: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """A sentence on fields that are not known and not read. Raises DataError for those that could change an image.

    ``what`` names the file. A field of all frames with one and the same value of nothing (null, false, zero, empty)
    says nothing.
    """
    counts = Counter(name for holder in (table, *frames) for name, value in holder.items() if is_set(value))
    unknown = [name for name in counts if name not in READ and name not in HARMLESS]
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
