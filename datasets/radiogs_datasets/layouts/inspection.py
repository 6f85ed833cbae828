"""Checks of every layout's loader: files exist, are complete, and fit together."""

import hashlib
import os
import unicodedata
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from functools import cached_property
from pathlib import Path

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import View

from ..bounded_reading import read_bytes
from ..image_structure import Header, image_header, usual_type

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


class WrittenPaths:
    """Finds the files that a table names in other words: Windows paths, another case or Unicode normal form of letters,
    paths from above the scene's folder. One is taken where exactly one file fits, and ``said`` tells how many were.

    Names without an ending get those of ``endings``.
    """

    def __init__(self, folder: Path, endings: Sequence[str] = ()) -> None:
        self.folder, self.endings = folder, tuple(dict.fromkeys(ending.casefold() for ending in endings))
        self.counts: Counter[str] = Counter()

    def find(self, table: Path, written: str) -> Path:
        """The file at a written path, or the one that it must mean; the path itself where there is none.

        Raises DataError for a path that leaves the scene's folder and names no file in it.
        """
        path = Path(os.path.normpath(self.folder / written))
        if path.is_relative_to(self.folder) and path.is_file():
            return path
        found, how = self._meant(written)
        if found is None:
            return inside(self.folder, table, written)
        self.counts[how] += 1
        return found

    @property
    def said(self) -> tuple[str, ...]:
        """A sentence for each way in which paths were written in other words."""
        return tuple(
            f"{count} written {'path is' if count == 1 else 'paths are'} {how}" for how, count in self.counts.items()
        )

    def _meant(self, written: str) -> tuple[Path | None, str]:
        parts = [part for part in written.replace("\\", "/").split("/") if part not in ("", ".")]
        for start in range(len(parts)):
            tail = "/".join(parts[start:])
            names = [tail, *(tail + ending for ending in self.endings)]  # Windows hides endings: 01.png.png
            fitting = [path for name in names for path in self._files.get(_plain(name), ())]
            if len(fitting) == 1:
                return fitting[0], self._how(written, tail, start, fitting[0])
            if fitting:
                break
        return None, ""

    def _how(self, written: str, tail: str, start: int, found: Path) -> str:
        if start:
            return "not from the scene's folder: the part below it is taken"
        if "\\" in written:
            return "of Windows: \\ is read as /"
        if found.relative_to(self.folder).as_posix().startswith(tail):
            return "without an ending, which the file has"
        return "unlike the file in case or Unicode normal form: the file is taken"

    @cached_property
    def _files(self) -> dict[str, list[Path]]:
        files: dict[str, list[Path]] = {}
        for place, _, names in os.walk(self.folder):
            for name in names:
                path = Path(place) / name
                files.setdefault(_plain(path.relative_to(self.folder).as_posix()), []).append(path)
        return files


def _plain(name: str) -> str:
    """A name without differences of case and of Unicode normal form."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


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


def inspect(
    files: Mapping[str, Path], tables: Sequence[Path] = (), numbers: Collection[Path] = ()
) -> tuple[dict[Path, Header], str]:
    """Headers of every image, and the SHA-256 over names and digests of all files in the names' order.

    ``tables`` come first in the digest, by their bare names. They, and ``.json``, ``.npy`` and ``.ply``, are no images.
    Colour profiles of images in ``numbers``, such as masks, are passed over.
    """
    headers, combined = {}, hashlib.sha256()
    for path in tables:
        combined.update(path.name.encode() + b"\0" + hashlib.sha256(read_bytes(path)).digest())
    for name, path in sorted(files.items()):
        data = read_bytes(path)
        combined.update(name.encode() + b"\0" + hashlib.sha256(data).digest())
        if path.suffix not in (".json", ".npy", ".ply"):
            headers[path] = image_header(path, data, path in numbers)
    return headers, combined.hexdigest()


def require_same_size(path: Path, size: tuple[int, int], wanted: tuple[int, int]) -> None:
    """Raises DataError if a map is not as large as its view's image."""
    if size != wanted:
        raise DataError(
            f"{path} is {size[1]} x {size[0]} pixels, its view's image {wanted[1]} x {wanted[0]}",
            "All maps of a view must have the same size.",
            "Export the map again, in the image's size.",
        )


def decode_if_small(
    views: Sequence[View], headers: Mapping[Path, Header], turned: Collection[Path] = ()
) -> tuple[str, ...]:
    """Read every map of a small scene and forget it. Raises DataError for the first damaged one.

    Returns sentences on images of another type than their names say, and with an orientation flag; ``turned`` are those
    that are turned by it.
    """
    if sum(header.height * header.width for header in headers.values()) <= SMALL_SCENE:
        for view in views:
            for name in view.sources:
                view.read(name)
    found: dict[str, list[str]] = {}
    for path, header in headers.items():
        if usual_type(path) != header.type:
            found.setdefault(f"of type {header.type}, unlike what their names say", []).append(path.name)
        if header.orientation > 1:
            applied = "applied: only then do they have the size of their cameras"
            done = applied if path in turned else "not applied: cameras are taken for pixels as they are stored"
            found.setdefault(f"of EXIF's orientation {header.orientation}, which is {done}", []).append(path.name)
    return tuple(
        f"{len(names)} {'image is' if len(names) == 1 else 'images are'} {what} ({shown(names)})"
        for what, names in found.items()
    )


def shown(names: Sequence[str]) -> str:
    """The first of them, and how many more there are."""
    rest = len(names) - NAMES_SHOWN
    return ", ".join(names[:NAMES_SHOWN]) + (f" and {rest} more" if rest > 0 else "")
