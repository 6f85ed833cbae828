"""The layout of a folder whose ``cameras.json`` lists its views.

<scene>/cameras.json   {"train": [...], "test": [...]}; each view has "image", "focal", in pixels, and
                       "camera_to_world", 4x4 with OpenCV's axes
<scene>/*.png          display sRGB with straight alpha
"""

import os
from functools import partial
from pathlib import Path
from typing import Any

import torch

from radiogs_core.errors import DataError
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.scene import Scene, View

from ..bounded_reading import read_json
from ..view_maps import read_alpha, read_photo
from .inspection import decode_if_small, inside, inspect, require_distinct, require_files

TABLE, FIELDS = "cameras.json", ("image", "focal", "camera_to_world")


def looks_like(folder: Path) -> bool:
    """Whether there is the list of views."""
    return (folder / TABLE).is_file()


def load_listed(folder: Path) -> Scene:
    """Read a scene; its maps are read when asked for. Raises DataError that names what is wrong."""
    folder = Path(os.path.normpath(folder.absolute()))
    listed = _checked(read_json(folder / TABLE))
    images = {split: [inside(folder, folder / TABLE, view["image"]) for view in listed[split]] for split in listed}
    every = [path for paths in images.values() for path in paths]
    require_files(folder, every)
    require_distinct(folder, every)
    headers, checksum = inspect({path.relative_to(folder).as_posix(): path for path in every}, [folder / TABLE])
    train, test = (
        tuple(_view(view, path, *headers[path].size) for view, path in zip(listed[split], images[split], strict=True))
        for split in ("train", "test")
    )
    decode_if_small([*train, *test], headers)
    return Scene(folder.name, "listed", train, test, {}, None, checksum)


def _checked(listed: Any) -> dict[str, list[dict[str, Any]]]:
    """The list of views by split. Raises DataError for a missing split, and for the first view that lacks a field."""
    for split in ("train", "test"):
        if not isinstance(listed, dict) or not isinstance(listed.get(split), list):
            raise DataError(f"{TABLE} has no list '{split}'", "It lists the views of each split.")
        for index, view in enumerate(listed[split]):
            lacks = [name for name in FIELDS if not isinstance(view, dict) or name not in view]
            if lacks:
                raise DataError(f"{TABLE}: {split}[{index}] has no '{lacks[0]}'", f"A view has {', '.join(FIELDS)}.")
    return listed


def _view(listed: dict[str, Any], image: Path, height: int, width: int) -> View:
    pose, focal = torch.tensor(listed["camera_to_world"]), listed["focal"]
    camera = Camera(pose, focal, focal, width / 2, height / 2, width, height)
    return View(image.stem, camera, {"image": partial(read_photo, image), "alpha": partial(read_alpha, image)})
