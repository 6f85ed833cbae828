"""Checks of every layout's loader: files exist, are complete, and fit together."""

import hashlib
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import View

from ..bounded_reading import read_bytes
from ..image_structure import image_size

SMALL_SCENE = 50_000_000
"""Pixels up to which every map is decoded when the scene is opened: damage is found before, not during, a run."""

NAMES_SHOWN = 8
"""How many of the files that are wrong an error lists."""


def inside(folder: Path, table: Path, file_path: str) -> Path:
    """The file that a table points to. Links are followed, but a written path may not leave the scene's folder."""
    path = Path(os.path.normpath(folder / file_path))
    if not path.is_relative_to(folder) or path == folder:
        raise DataError(
            f"{table} points to '{file_path}'",
            "A view lies inside the scene's folder; nothing outside that is read.",
            "Correct the file.",
        )
    return path


def require_distinct(folder: Path, places: Sequence[Path]) -> None:
    """Raises DataError if a view is listed twice, in one split or in two."""
    counts = Counter(place.relative_to(folder).as_posix() for place in places)
    twice = [place for place, count in counts.items() if count > 1]
    if twice:
        raise DataError(
            f"scene '{folder.name}' lists views twice: {shown(twice)}",
            "Such a view would count twice, or be trained on and then scored.",
            "Take one of them out of the transforms files.",
        )
    files: dict[str, list[str]] = {}
    for place in places:
        files.setdefault(os.path.realpath(place), []).append(place.relative_to(folder).as_posix())
    same = next((names for names in files.values() if len(names) > 1), None)
    if same:
        raise DataError(
            f"scene '{folder.name}' has one image for {len(same)} views: {shown(same)}",
            "They are links to one place. The view would count twice, or be trained on and then scored.",
            "Put each view's own image in its place.",
        )


def require_files(folder: Path, wanted: Sequence[Path]) -> None:
    """Raises DataError that names the files that are not there."""
    missing = [path.relative_to(folder).as_posix() for path in wanted if not path.is_file()]
    if missing:
        raise DataError(
            f"scene '{folder.name}' lacks {len(missing)} {'file' if len(missing) == 1 else 'files'}: {shown(missing)}",
            "Every view must have its image, and a map that one view of a split has, all views of it must have.",
            "Complete the folder, take the views out of the transforms file, or remove the map from all views.",
        )


def inspect(files: Mapping[str, Path], tables: Sequence[Path] = ()) -> tuple[dict[Path, tuple[int, int]], str]:
    """Height and width of every image, and the SHA-256 over names and digests of all files in the names' order.

    ``tables`` come first in the digest, by their bare names. They, and ``.json``, ``.npy`` and ``.ply``, are no images.
    """
    sizes, combined = {}, hashlib.sha256()
    for path in tables:
        combined.update(path.name.encode() + b"\0" + hashlib.sha256(read_bytes(path)).digest())
    for name, path in sorted(files.items()):
        data = read_bytes(path)
        combined.update(name.encode() + b"\0" + hashlib.sha256(data).digest())
        if path.suffix not in (".json", ".npy", ".ply"):
            sizes[path] = image_size(path, data)
    return sizes, combined.hexdigest()


def require_same_size(path: Path, size: tuple[int, int], wanted: tuple[int, int]) -> None:
    """Raises DataError if a map is not as large as its view's image."""
    if size != wanted:
        raise DataError(
            f"{path} is {size[1]} x {size[0]} pixels, its view's image {wanted[1]} x {wanted[0]}",
            "All maps of a view must have the same size.",
            "Export the map again, in the image's size.",
        )


def decode_if_small(views: Sequence[View], sizes: Mapping[Path, tuple[int, int]]) -> None:
    """Read every map of a small scene and forget it. Raises DataError for the first damaged one."""
    if sum(height * width for height, width in sizes.values()) <= SMALL_SCENE:
        for view in views:
            for name in view.sources:
                view.read(name)


def shown(names: Sequence[str]) -> str:
    """The first of them, and how many more there are."""
    rest = len(names) - NAMES_SHOWN
    return ", ".join(names[:NAMES_SHOWN]) + (f" and {rest} more" if rest > 0 else "")
