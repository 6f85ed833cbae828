"""Checks of every layout's loader: files exist, are complete, and fit together."""

import hashlib
import os
import re
import unicodedata
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import View

from ..bounded_reading import read_bytes
from ..image_files import DECODED, Decoded
from ..image_structure import Header, image_header, usual_type
from ..options import TEST_EVERY
from ..same_bytes import note_pixels, within

SMALL_SCENE = 50_000_000
"""Largest number of a scene's pixels for which every map is decoded on opening: damage is found before a run."""

NAMES_SHOWN = 8
"""Number of wrong files that an error lists."""

IMAGE_ENDINGS = (".png", ".jpg", ".jpeg", ".webp", ".exr", ".hdr")
"""Endings of photos that are read."""

NO_IMAGES = (".json", ".npy", ".ply", ".txt")

SPLIT_LIST = re.compile(
    r"(?:.*/)?(train|test|val)(?:_(?:list|split|images|names|files|filenames|views))?(?:\.txt)?", re.IGNORECASE
)
"""Names of lists of photos, with the split: nerf-on-the-go's ``train_list.txt``, 3DGS's ``sparse/0/test.txt``,
nerfstudio's field ``test_filenames``."""

NUMBER = re.compile(r"0*(\d+)")
"""A number in a name, without the zeros before it."""

Kept = TypeVar("Kept")


def inside(folder: Path, table: Path, file_path: str) -> Path:
    """The file that a table names. Links are followed, but a written path may not leave the scene's folder."""
    path = Path(os.path.normpath(folder / file_path))
    if not path.is_relative_to(folder) or path == folder:
        raise DataError(
            f"{table} points to '{file_path}'",
            "A view lies inside the scene's folder; nothing outside that is read.",
            "Correct the file.",
        )
    return path


class WrittenPaths:
    """Finds files whose names are written differently in a table: Windows paths, another case or Unicode normal form,
    paths from above the scene's folder. A file is accepted if it is the only match; ``said`` counts these.

    Names without an ending get those of ``endings``.
    """

    def __init__(self, folder: Path, endings: Sequence[str] = ()) -> None:
        self.folder, self.endings = folder, tuple(dict.fromkeys(ending.casefold() for ending in endings))
        self.counts: Counter[str] = Counter()

    def find(self, table: Path, written: str) -> Path:
        """The file at a written path, or its only match; the path itself if no file matches.

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

    def find_photo(self, table: Path, written: str) -> Path:
        """As ``find``; else the only readable image at that place with the same name up to ``alike``."""
        path = self.find(table, written)
        if path.is_file() and path.suffix.lower() in IMAGE_ENDINGS:
            return path
        fitting = self._photos.get(alike(path.relative_to(self.folder).as_posix()), ())
        if len(fitting) != 1:
            return path
        self.counts["unlike the photo in its ending, or in zeros before its numbers: the photo is taken"] += 1
        return fitting[0]

    @property
    def said(self) -> tuple[str, ...]:
        """A sentence for each way in which written paths differed from files."""
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
                own = fitting[0].relative_to(self.folder).as_posix()
                ways = (
                    (start > 0, "not from the scene's folder: the part below it is taken"),
                    ("\\" in written, "of Windows: \\ is read as /"),
                    (own.startswith(tail), "without an ending, which the file has"),
                    (True, "unlike the file in case or Unicode normal form: the file is taken"),
                )
                return fitting[0], next(how for holds, how in ways if holds)
            if fitting:
                break
        return None, ""

    @cached_property
    def _files(self) -> dict[str, list[Path]]:
        files: dict[str, list[Path]] = {}
        for place, _, names in os.walk(self.folder):
            for name in names:
                path = Path(place) / name
                files.setdefault(_plain(path.relative_to(self.folder).as_posix()), []).append(path)
        return files

    @cached_property
    def _photos(self) -> dict[str, list[Path]]:
        photos: dict[str, list[Path]] = {}
        for path in (path for paths in self._files.values() for path in paths if path.suffix.lower() in IMAGE_ENDINGS):
            photos.setdefault(alike(path.relative_to(self.folder).as_posix()), []).append(path)
        return photos


def _plain(name: str) -> str:
    """A name without differences of case and of Unicode normal form."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def alike(name: str) -> str:
    """The part that all names of one photo share: no ending, case or zeros (frame_1.HEIC, frame_0001.jpg)."""
    return NUMBER.sub(r"\1", re.sub(r"\.[a-z][a-z0-9]{1,4}$", "", _plain(name)))


def by_number(name: str) -> list[tuple[int, str]]:
    """The key by which names are sorted as people count: frame_2 before frame_10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", _plain(name))]


def paired(names: Sequence[str], files: Sequence[Path], renumbered: bool) -> tuple[dict[str, Path], str]:
    """Pairs names with as many differently named files, by equal numbers, else in the order of names; and a sentence.

    ``renumbered``: whether files may have been renumbered, so that equal numbers are meaningless. Raises DataError
    where the orders of names as text and by number differ, or where some numbers are equal and others are not.
    """
    own = {(*NUMBER.findall(path.stem),): path for path in files}
    equal = {name: own[numbers] for name in names if (numbers := (*NUMBER.findall(Path(name).stem),)) in own}
    if len({*equal.values()}) == len(names):
        return equal, f"by their numbers ({names[0]} with {equal[names[0]].name})"
    pairs = dict(zip(sorted(names), sorted(files), strict=True))
    counted = dict(zip(sorted(names, key=by_number), sorted(files, key=lambda path: by_number(path.name)), strict=True))
    counted |= {} if renumbered else equal
    require_one_order(files[0].parent, [(name, file, counted[name]) for name, file in pairs.items()])
    return pairs, f"in the order of names ({names[0]} with {pairs[names[0]].name})"


def require_one_order(folder: Path, pairs: Iterable[tuple[str, Path, Path]]) -> None:
    """Raises DataError if names paired in the order of text and in the order of numbers differ."""
    differ = [f"{name} with {by_text.name} or {counted.name}" for name, by_text, counted in pairs if by_text != counted]
    if differ:
        raise DataError(
            f"which images of {folder} belong to which poses is not certain: names do not say it",
            f"By text or by number they would be paired otherwise: {shown(differ)}.",
            "Call the images as the photos with poses are; poses without names follow images numbered 01, 02, ... 10.",
        )


def split_lists(folder: Path, *places: Path) -> dict[str, Path]:
    """Text files that list the photos of a split, by their paths below the scene's folder: the first of each split."""
    found: dict[str, Path] = {}
    for path in (path for place in places for path in sorted(place.glob("*.txt"))):
        if listed := SPLIT_LIST.fullmatch(path.name):
            found.setdefault(listed[1].lower(), path)
    return {path.relative_to(folder).as_posix(): path for path in found.values()}


def names_in(lists: Mapping[str, Path]) -> dict[str, tuple[str, ...]]:
    """The names of photos in text files, one per line; empty lines and comments (#) are skipped."""
    lines = {label: read_bytes(path).decode(errors="replace").splitlines() for label, path in lists.items()}
    return {
        label: tuple(name for line in each if (name := line.strip()) and name[0] != "#")
        for label, each in lines.items()
    }


def split_views(
    ordered: Sequence[Kept], name_of: Callable[[Kept], str], splits: Mapping[str, Sequence[str]], step: int | None
) -> tuple[list[Kept], list[Kept], tuple[str, ...]]:
    """Training and test views by the published lists of a split, or every ``step``-th for testing; and sentences.

    ``splits``: names of photos, by names of lists (``SPLIT_LIST``). Without ``step`` and lists every eighth view is
    scored, from the first on. Raises DataError for a list that names no view, and for a view in both lists.
    """
    if step is not None or not splits:
        every = step or TEST_EVERY
        train = [each for place, each in enumerate(ordered) if place % every]
        return train, list(ordered[::every]), (f"every {every}th view is scored",)
    labels = {listed[1].lower(): label for label in splits if (listed := SPLIT_LIST.fullmatch(label))}
    keys, said = [alike(name_of(each)).split("/") for each in ordered], []
    named: dict[str, set[int]] = {}
    for split, label in labels.items():
        found = {name: _view_called(name, keys) for name in splits[label]}
        named[split] = {place for place in found.values() if place is not None}
        if not named[split]:
            raise DataError(
                f"{label} names no view of the scene: {shown(splits[label])}",
                f"It is taken for a list of a split; views are called {shown([name_of(each) for each in ordered])}.",
                "Correct or remove it, or hold views out instead:  --hold-out 8",
            )
        if lost := [name for name, place in found.items() if place is None]:
            said.append(f"{len(lost)} of {len(found)} names in {label} are no views of the scene: {shown(lost)}")
    every_view = {*range(len(ordered))}
    test = named.get("test") or named.get("val") or every_view - named["train"]
    train_places = named.get("train", every_view - test)
    said.insert(0, f"views of {labels.get('test') or labels.get('val') or 'no training list'} are scored")
    return _apart(ordered, name_of, train_places, test, said)


def _apart(
    ordered: Sequence[Kept], name_of: Callable[[Kept], str], train: set[int], test: set[int], said: list[str]
) -> tuple[list[Kept], list[Kept], tuple[str, ...]]:
    """The views of both splits, in their order. Raises DataError for views in both, and for a split without any."""
    both = shown([name_of(ordered[place]) for place in sorted(train & test)])
    if both or not train or not test:
        raise DataError(
            f"the lists of the scene's splits have views in common: {both}"
            if both
            else "a split of the scene is empty",
            "A view that is trained on says nothing when it is scored, and both splits need views.",
            "Correct the lists, or hold views out instead:  --hold-out 8",
        )
    if left := [name_of(each) for place, each in enumerate(ordered) if place not in train | test]:
        said.append(f"{len(left)} views are in neither list and are left out: {shown(left)}")
    return [ordered[place] for place in sorted(train)], [ordered[place] for place in sorted(test)], tuple(said)


def _view_called(name: str, keys: Sequence[Sequence[str]]) -> int | None:
    """The index of the one view that a list means, by the longest common end of both paths; None without one."""
    parts = [part for part in alike(name.replace("\\", "/")).split("/") if part != "."]
    for length in range(len(parts), 0, -1):
        fitting = [place for place, key in enumerate(keys) if key[-length:] == parts[-length:]]
        if fitting:
            return fitting[0] if len(fitting) == 1 else None
    return None


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
    """Raises DataError that names the missing files."""
    missing = [path.relative_to(folder).as_posix() for path in wanted if not path.is_file()]
    if missing:
        nearest = next(place for place in (folder / missing[0]).parents if place.is_dir())
        there = sorted(each.name for each in nearest.iterdir() if not each.name.startswith("."))
        raise DataError(
            f"scene '{folder.name}' lacks {len(missing)} {'file' if len(missing) == 1 else 'files'}: {shown(missing)}",
            "Every view must have its image, and a map that one view of a split has, all views of it must have. "
            f"In {nearest.relative_to(folder.parent).as_posix()} there are: {shown(there) or 'no files'}.",
            "Complete the folder, take the views out of the transforms file, or remove the map from all views.",
        )


def inspect(
    files: Mapping[str, Path], tables: Sequence[Path] = (), numbers: Collection[Path] = ()
) -> tuple[dict[Path, Header], str]:
    """Headers of every image, and the SHA-256 over names and digests of all files in the names' order.

    ``tables`` come first in the digest, by their bare names. They, and ``NO_IMAGES``, are not images. Colour profiles
    of images in ``numbers``, such as masks, are ignored.
    """
    headers, combined = {}, hashlib.sha256()
    for path in tables:
        combined.update(path.name.encode() + b"\0" + hashlib.sha256(read_bytes(path)).digest())
    for name, path in sorted(files.items()):
        data = read_bytes(path)
        combined.update(name.encode() + b"\0" + hashlib.sha256(data).digest())
        if path.suffix not in NO_IMAGES:
            headers[path] = image_header(path, data, path in numbers)
    return headers, combined.hexdigest()


def require_same_size(path: Path, size: tuple[int, int], wanted: tuple[int, int]) -> None:
    """Raises DataError if a map's size differs from its view's image."""
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

    Returns sentences on images of another type than their names' ending, and on orientation flags; ``turned``: images
    that are turned by theirs.
    """
    if sum(header.height * header.width for header in headers.values()) <= SMALL_SCENE:
        for view in views:
            files: Decoded = {}
            with within(DECODED, files):
                for name in view.sources:
                    view.read(name)
            for (path, *_), levels in files.items():
                if not isinstance(levels, DataError) and levels.dtype != np.float32:
                    note_pixels(path, levels)
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
    """The first of some names, and the number of further ones."""
    rest = len(names) - NAMES_SHOWN
    return ", ".join(names[:NAMES_SHOWN]) + (f" and {rest} more" if rest > 0 else "")
