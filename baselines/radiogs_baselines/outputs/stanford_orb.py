"""Results in the formats of Stanford-ORB: a JSON of pairs of files, and nvdiffrec's validation images.

The JSON (``info[scene]`` with ``view``, ``light``, ``geometry``, ``material``, ``shape``) names each output and its
target. The JSON does not say to which folder its paths are relative, so they are searched for in its folder and all
parent folders, also without their first parts. An output may be ``null``: the method does not predict it. nvdiffrec
writes ``val_<k>_opt.png`` beside the reference ``val_<k>_ref.png``.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from radiogs_core.errors import DataError
from radiogs_datasets.bounded_reading import read_json

from .files import unread_files

Task = Literal["nvs", "relight", "albedo", "depth", "normal", "shape"]
"""Tasks of the benchmark."""

IMAGES: Mapping[str, Task] = {"view": "nvs", "light": "relight", "material": "albedo"}
"""Tasks by the JSON's keys of lists of images."""


@dataclass(frozen=True)
class Pair:
    """An output and its target."""

    capture: str
    """Name of the captured scene."""
    task: Task
    """Task of the pair."""
    output: Path | None
    """File of the output; None if it does not exist."""
    target: Path | None
    """File of the target; None if it does not exist."""
    mask: Path | None
    """File of the target's mask; None without one."""
    wanted: tuple[str | None, str]
    """Paths of output and target as in the JSON, or relative to the folder of validation images; None for ``null``."""

    @property
    def predicted(self) -> bool:
        """Whether the JSON names an output."""
        return self.wanted[0] is not None

    @property
    def counts_as_white(self) -> bool:
        """Whether Stanford-ORB's evaluator compares a white image: for an image or albedo that is not predicted."""
        return not self.predicted and self.task in IMAGES.values()

    @property
    def lacking(self) -> tuple[str, ...]:
        """Named paths of output and target that do not exist."""
        found = (self.output, self.target)
        return tuple(path for path, file in zip(self.wanted, found, strict=True) if path is not None and file is None)


def read_pairs(path: Path) -> list[Pair]:
    """All pairs of a JSON, or of a folder that contains such a JSON or validation images at any depth.

    Raises DataError for a file that is not such a JSON, and for a folder without pairs.
    """
    if not path.exists():
        raise DataError(f"there is no {path}", "", "Give a JSON of pairs, or an output folder.")
    path = path.absolute()
    if path.is_file():
        return list(_pairs_of(path))
    files = [file for file in sorted(path.rglob("*.json")) if _is_handed_in(file)]
    pairs = [pair for file in files for pair in _pairs_of(file)]
    named = {pair.output for pair in pairs}
    pairs += [pair for pair in _validation_pairs(path) if pair.target is not None or pair.output not in named]
    if not pairs:
        raise DataError(
            f"{path} holds no Stanford-ORB results",
            "Such results are a JSON with 'info', or val_<k>_opt.png beside val_<k>_ref.png.",
            "Give the JSON that the benchmark's script reads, or nvdiffrec's output folder.",
        )
    return pairs


def unread(path: Path, pairs: Iterable[Pair]) -> list[str]:
    """Files in the folder that are neither output, target nor mask of a pair (see ``unread_files``)."""
    if path.is_file():
        return []
    read = {file.absolute() for pair in pairs for file in (pair.output, pair.target, pair.mask) if file is not None}
    return unread_files(path.absolute(), read, ())


def holds_pairs(path: Path) -> bool:
    """Whether ``path`` is a JSON of pairs, or contains one, or validation images with references, at any depth."""
    files = [path] if path.is_file() else path.rglob("*.json")
    return any(map(_is_handed_in, files)) or any(pair.target is not None for pair in _validation_pairs(path))


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
            f"{file} is not in the format of Stanford-ORB's script",
            f"An entry cannot be read: {type(error).__name__} {error}.",
            "See docs/protocols.md for the keys.",
        ) from error


def _pair(file: Path, capture: str, task: Task, named: tuple[str | None, str], mask: str | None) -> Pair:
    output, target, masked = (None if path is None else _located(file, path) for path in (*named, mask))
    return Pair(capture, task, output, target, masked, named)


def _mask_of(target: str) -> str:
    """Path of a target's mask: ``<folder>_mask/<name>.png`` beside the target's folder."""
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
