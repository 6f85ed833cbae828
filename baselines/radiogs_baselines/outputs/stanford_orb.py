"""Stanford-ORB's own way of handing results in: a JSON of pairs of files, and nvdiffrec's validation images.

The JSON (``info[scene]`` with ``view``, ``light``, ``geometry``, ``material``, ``shape``) names each output beside its
target. Its paths are relative to somewhere; they are looked for below the JSON's folder and all folders above it, with
as many of their parts as lead to a file. nvdiffrec writes ``val_<k>_opt.png`` beside the reference it compared with,
``val_<k>_ref.png``.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from radiogs_core.errors import DataError
from radiogs_datasets.bounded_reading import read_json

from .unread import unread_files

Task = Literal["nvs", "relight", "albedo", "depth", "normal", "shape"]
IMAGES: Mapping[str, Task] = {"view": "nvs", "light": "relight", "material": "albedo"}


@dataclass(frozen=True)
class Pair:
    """An output and its target, as far as the files exist; ``wanted`` are the paths as they were named."""

    capture: str
    task: Task
    output: Path | None
    target: Path | None
    mask: Path | None
    wanted: tuple[str, str]

    @property
    def lacking(self) -> tuple[str, ...]:
        """Paths of output and target that lead to no file."""
        found = (self.output, self.target)
        return tuple(path for path, file in zip(self.wanted, found, strict=True) if file is None)


def read_pairs(place: Path) -> list[Pair]:
    """All pairs of a JSON, or of a folder that holds such a JSON or validation images, at any depth.

    Raises DataError for a file that is no such JSON, and for a folder without either.
    """
    if not place.exists():
        raise DataError(f"there is no {place}", "", "Give a JSON of pairs, or an output folder.")
    place = place.absolute()
    if place.is_file():
        return list(_pairs_of(place))
    files = [file for file in sorted(place.rglob("*.json")) if _is_handed_in(file)]
    pairs = [pair for file in files for pair in _pairs_of(file)]
    named = {pair.output for pair in pairs}
    pairs += [pair for pair in _validation_pairs(place) if pair.target is not None or pair.output not in named]
    if not pairs:
        raise DataError(
            f"{place} holds no Stanford-ORB results",
            "Looked for a JSON with 'info', and for val_<k>_opt.png beside val_<k>_ref.png.",
            "Give the JSON that the benchmark's script takes, or nvdiffrec's output folder.",
        )
    return pairs


def unread(place: Path, pairs: Iterable[Pair]) -> list[str]:
    """What lies in the folder and is neither output, target nor mask of a pair (see ``unread_files``)."""
    if place.is_file():
        return []
    read = {file.absolute() for pair in pairs for file in (pair.output, pair.target, pair.mask) if file is not None}
    return unread_files(place.absolute(), read, ())


def holds_pairs(place: Path) -> bool:
    """Whether it is, or holds at any depth, a JSON of pairs or validation images beside their references."""
    files = [place] if place.is_file() else place.rglob("*.json")
    return any(map(_is_handed_in, files)) or any(pair.target is not None for pair in _validation_pairs(place))


def _validation_pairs(folder: Path) -> Iterator[Pair]:
    for output in sorted(folder.rglob("val_*_opt.png")):
        target = output.with_name(output.name.replace("_opt.png", "_ref.png"))
        named = (output.relative_to(folder).as_posix(), target.relative_to(folder).as_posix())
        there = target if target.is_file() else None
        yield Pair(f"{output.parent.name} (own reference)", "nvs", output, there, None, named)


def _pairs_of(file: Path) -> Iterator[Pair]:
    try:
        for capture, entries in read_json(file)["info"].items():
            for kind, task in IMAGES.items():
                for entry in entries.get(kind, []):
                    named = (entry["output_image"], entry["target_image"])
                    yield _pair(file, capture, task, named, entry.get("target_mask") or _mask_of(named[1]))
            for entry in entries.get("geometry", []):
                mask = entry["target_mask"]
                yield _pair(file, capture, "depth", (entry["output_depth"], entry["target_depth"]), mask)
                yield _pair(file, capture, "normal", (entry["output_normal"], entry["target_normal"]), mask)
            if shape := entries.get("shape"):
                yield _pair(file, capture, "shape", (shape["output_mesh"], shape["target_mesh"]), None)
    except (KeyError, TypeError, AttributeError) as error:
        raise DataError(
            f"{file} is not what Stanford-ORB's script takes",
            f"An entry cannot be read: {type(error).__name__} {error}.",
            "See docs/scoring.md for the keys.",
        ) from error


def _pair(file: Path, capture: str, task: Task, named: tuple[str, str], mask: str | None) -> Pair:
    output, target = (_located(file, path) for path in named)
    return Pair(capture, task, output, target, None if mask is None else _located(file, mask), named)


def _mask_of(target: str) -> str:
    """Masks lie in ``<folder>_mask/<name>.png`` beside the target's folder."""
    path = Path(target)
    return str(path.parent.with_name(path.parent.name + "_mask") / f"{path.stem}.png")


def _located(file: Path, path: str) -> Path | None:
    parts = Path(path).parts
    for kept in range(len(parts)):
        for folder in file.absolute().parents:
            candidate = folder.joinpath(*parts[kept:])
            if ".." not in parts and candidate.is_file():
                return candidate
        if Path(path).is_absolute():
            return None
    return None


def _is_handed_in(file: Path) -> bool:
    try:
        return isinstance(read_json(file).get("info"), dict)
    except (DataError, AttributeError):
        return False
