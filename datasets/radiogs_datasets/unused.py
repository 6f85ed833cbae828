"""Unused files of a scene's folder: masks, photos without a camera, other sizes, splits and lists, images.

Each kind is one sentence among the scene's repairs, which ``datasets check``, ``train`` and ``run`` print. None is an
error; but a capture that lost half of its photos, or whose masks are not read, is not what its owner means.
"""

import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

from .image_structure import usual_type
from .layouts.inspection import shown
from .layouts.masks import mask_among

MASK_FOLDER = re.compile(r"(.*[_-])?(masks?|segmentations?|silhouettes?|mattes?)([_-].*)?", re.IGNORECASE)
"""Names of folders that hold masks."""

IGNORING = re.compile(r"(.*[/_-])?(dynamic|ignore|transient)[_-]?masks?([/_.-].*)?", re.IGNORECASE)
"""Paths of masks of moving things (instant-ngp: ``dynamic_mask_NAME.png``), whose white pixels are ignored."""

SIZED = re.compile(r"images(_\d+)?")
"""Folders of the same photos in several sizes."""

TABLE = re.compile(r"transforms(?:_(\w+))?\.json")
"""Files of cameras, with the name of their split."""

DIGITS = re.compile(r"\d+")

SPLIT = re.compile(
    r"(.*[_.-])?(train|test|val|eval|split|hold_?out)s?([_.-].*)?\.(txt|csv|tsv|lst|json|npy|ya?ml)", re.IGNORECASE
)
"""Names of files that may list the views of a split."""


def unused_files(folder: Path, used: Iterable[str]) -> tuple[str, ...]:
    """Sentences on the images and transforms files below a folder that a loader has not read.

    ``used``: absolute paths of the files that it has read. Hidden files and folders are passed over.
    """
    taken = {*used}
    top = Path(os.path.abspath(folder))
    every = list(_files(top))
    rest = [path.relative_to(top) for path in every if str(path) not in taken]
    left = [path for path in rest if usual_type(path)]
    read = [path.relative_to(top) for path in every if str(path) in taken and usual_type(path)]
    masks, left = _masks(folder, left, read)
    moving, left = _moving(left)
    sizes, left = _sizes(left, read)
    splits, left = _splits(rest, left)
    lost, left = _without_view(left, read)
    counts = Counter(path.parent.as_posix() for path in left)
    listing = [path.as_posix() for path in rest if SPLIT.fullmatch(path.name) and not TABLE.fullmatch(path.name)]
    lists = [f"files that may list the views of a split are not used: {shown(listing)}"] if listing else []
    places = [f"{count} in {'the folder itself' if place == '.' else place}" for place, count in counts.items()]
    others = [f"{_are(left, 'other image')} not used: {shown(places)}"] if left else []
    return (*masks, *moving, *sizes, *splits, *lists, *lost, *others)


Said = tuple[list[str], list[Path]]
"""Sentences on some of the images that are left, and the others."""


def _files(top: Path) -> Iterator[Path]:
    for place, folders, names in os.walk(top):
        folders[:] = sorted(name for name in folders if not name.startswith((".", "__MACOSX")))
        yield from (Path(place) / name for name in sorted(names) if not name.startswith("."))


def _masks(folder: Path, left: list[Path], read: list[Path]) -> Said:
    """Sentences on folders of masks beside the photos, complete or not."""
    names: dict[str, dict[str, Path]] = {}
    for path in left:
        top = path.parts[0]
        if len(path.parts) > 1 and MASK_FOLDER.fullmatch(top) and not IGNORING.fullmatch(path.as_posix()):
            names.setdefault(top, {})[path.relative_to(top).as_posix().casefold()] = path
    said = []
    for top, files in names.items():
        # A photo's mask lies there with the photo's folders, without the first of them, or flat.
        found = [
            path
            for path in read
            if any(mask_among(files, "/".join(path.parts[start:])) for start in {0, min(1, len(path.parts) - 1), -1})
        ]
        if len(found) == len(read):
            said.append(f"{top}/ has a mask for each photo, and is not used:  --mask-folder {folder / top}")
        else:
            said.append(f"{top}/ is not used: it has masks for {len(found)} of {len(read)} photos")
    taken = {path for files in names.values() for path in files.values()}
    return said, [path for path in left if path not in taken]


def _moving(left: list[Path]) -> Said:
    moving = [path for path in left if IGNORING.fullmatch(path.as_posix())]
    names = shown([path.as_posix() for path in moving])
    said = (
        f"{_are(moving, 'mask', ' of what moves')} not used: {names}; to leave such pixels out, give a"
        " folder of masks that are black there:  --mask-folder DIR --masks ignore"
    )
    return [said] if moving else [], [path for path in left if path not in {*moving}]


def _sizes(left: list[Path], read: list[Path]) -> Said:
    """Sentences on folders of photos in other sizes than the one that is read."""
    used = {path.parts[0] for path in read if SIZED.fullmatch(path.parts[0])}
    counts = Counter(path.parts[0] for path in left if len(path.parts) > 1 and SIZED.fullmatch(path.parts[0]))
    others = sorted(name for name in counts if used and name not in used)
    named = ", ".join(f"{name} ({counts[name]})" for name in others)
    said = [f"photos of other sizes are not used: {named}"] if others else []
    return said, [path for path in left if path.parts[0] not in others]


def _splits(files: list[Path], left: list[Path]) -> Said:
    """Sentences on transforms files that are not read, and the images in the folder of their split."""
    said = []
    for table in (path for path in files if len(path.parts) == 1 and TABLE.fullmatch(path.name)):
        split = TABLE.fullmatch(table.name)[1]  # type: ignore[index]
        own = [path for path in left if len(path.parts) > 1 and path.parts[0] == split]
        said.append(f"{table.name} is not used" + (f", nor are {len(own)} images in {split}" if own else ""))
        left = [path for path in left if path not in {*own}]
    return said, left


def _without_view(left: list[Path], read: list[Path]) -> Said:
    """Sentences on images without a view: named like the views' images up to digits, or in a folder of photos."""
    alike = {DIGITS.sub("#", path.as_posix()) for path in read}
    places = {path.parent for path in read if path.parent.parts and SIZED.fullmatch(path.parent.parts[0])}
    lost = [path for path in left if DIGITS.sub("#", path.as_posix()) in alike or path.parent in places]
    total = len(lost) + len([path for path in read if path.parent in {each.parent for each in lost}])
    said = f"{len(lost)} of {total} photos are in no view and are not used: {shown([p.as_posix() for p in lost])}"
    return [said] if lost else [], [path for path in left if path not in {*lost}]


def _are(things: list[Path], word: str, rest: str = "") -> str:
    return f"1 {word}{rest} is" if len(things) == 1 else f"{len(things)} {word}s{rest} are"
