"""The views of a scene's ``transforms`` files: which there are, their files, and which of them are scored."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from radiogs_core.errors import DataError

from ..options import SceneOptions
from ..transforms import Frame, Transforms
from .inspection import inside, require_files, shown
from .photos import held_out, masks_of

SINGLE = "transforms.json"

SCORED = ("test", "val")
"""What is scored: the test split, or the validation split where there is no other."""

ENDINGS = (".png", ".jpg", ".jpeg", ".JPG", ".JPEG", ".PNG")

MOST_ABSENT = 0.5
"""Share of a single file's photos that may be absent: with more the folder is taken for incomplete."""


@dataclass(frozen=True)
class Listed:
    """A frame with the files that it names."""

    frame: Frame
    image: Path
    mask: Path | None
    depth: Path | None
    depth_unit: float

    def files(self) -> list[Path]:
        """All of them that there are."""
        return [path for path in (self.image, self.mask, self.depth) if path is not None]


def tables_of(folder: Path, options: SceneOptions) -> list[Path]:
    """The single file; or the training file, and that of the split which is scored unless views are held out."""
    train = folder / "transforms_train.json"
    if (folder / SINGLE).is_file() and not train.is_file():
        return [folder / SINGLE]
    scored = [path for split in SCORED if (path := folder / f"transforms_{split}.json").is_file()]
    if options.hold_out is not None:
        return [train]
    if not scored:
        raise DataError(
            f"scene '{folder.name}' has no transforms_test.json",
            "Without views that are not trained on nothing can be scored.",
            "Complete the folder, or score every eighth training view:  --hold-out 8",
        )
    return [train, scored[0]]


def listed_in(folder: Path, table: Path, transforms: Transforms) -> list[Listed]:
    """The views of a file with the paths that it names. Raises DataError for one that leaves the scene's folder."""

    def place(path: str | None) -> Path | None:
        return None if path is None else inside(folder, table, path)

    return [
        Listed(frame, _image(folder, table, frame), place(frame.mask_path), place(frame.depth_path), unit)
        for unit in [transforms.depth_unit]
        for frame in transforms.frames
    ]


def _image(folder: Path, table: Path, frame: Frame) -> Path:
    """The image as written, or with the ending that a file has; PNG where there is none."""
    path = inside(folder, table, frame.file_path)
    if path.suffix.lower() in ENDINGS or path.is_file():
        return path
    named = [path.with_name(path.name + ending) for ending in ENDINGS]
    return next((choice for choice in named if choice.is_file()), named[0])


def present(folder: Path, listed: list[Listed], repairs: list[str]) -> list[Listed]:
    """The photos that are there. Raises DataError if most are not."""
    absent = [each.image for each in listed if not each.image.is_file()]
    if len(absent) > MOST_ABSENT * len(listed):
        require_files(folder, absent)
    if absent:
        names = shown(sorted(path.relative_to(folder).as_posix() for path in absent))
        repairs.append(f"{len(absent)} of {len(listed)} views have no image and are left out: {names}")
    return [each for each in listed if each.image.is_file()]


def split_of(
    folder: Path, files: Mapping[Path, Transforms], options: SceneOptions, repairs: list[str]
) -> tuple[list[Listed], list[Listed]]:
    """Training and test views; how they were told apart, and what was left out, is added to ``repairs``."""
    listed = {table: listed_in(folder, table, transforms) for table, transforms in files.items()}
    if len(files) == 2:
        train, test = files
        if test.name != "transforms_test.json":
            repairs.append("no test split: the validation split is scored")
        return listed[train], listed[test]
    (table,) = files
    views = present(folder, listed[table], repairs) if table.name == SINGLE else listed[table]
    named = files[table].splits
    scored = next((split for split in SCORED if split in named), None)
    if options.hold_out is None and scored is not None:
        repairs.append(f"views of {scored}_filenames are scored")
        test_views = _of_split(folder, table, named[scored], views)
        rest = [each for each in views if each not in test_views]
        return (_of_split(folder, table, named["train"], views) if "train" in named else rest), test_views
    ordered = sorted(views, key=lambda each: each.frame.file_path)
    if len(ordered) < 2:
        raise DataError(f"{table} has one view", "One must be left to score.", "Give at least two.")
    train_views, test_views, said = held_out(ordered, options.hold_out)
    repairs.append(f"one file without a split: {said}" if table.name == SINGLE else said)
    return train_views, test_views


def _of_split(folder: Path, table: Path, names: tuple[str, ...], listed: list[Listed]) -> list[Listed]:
    """The views of a list of images; those whose photo is absent are left out as elsewhere."""
    known = {each.frame.file_path.removeprefix("./") for each in listed}
    absent = [name for name in names if name.removeprefix("./") not in known and (folder / name).is_file()]
    chosen = {name.removeprefix("./") for name in names}
    found = [each for each in listed if each.frame.file_path.removeprefix("./") in chosen]
    if absent or not found:
        raise DataError(
            f"{table}: a split names views that are no frames: {shown(absent or list(names))}",
            "Each has its camera among the 'frames'.",
            "Correct the file, or hold views out instead:  --hold-out 8",
        )
    return found


def masked(folder: Path, listed: list[Listed], options: SceneOptions) -> list[Listed]:
    """The views with the masks of the folder of masks, if one was given, in place of the file's."""
    if options.mask_folder is None:
        return listed
    named = [(each.image.relative_to(folder).as_posix(), each.image) for each in listed]
    if not any((Path(options.mask_folder) / name).parent.is_dir() for name, _ in named):
        named = [(path.name, path) for _, path in named]
    masks = masks_of(options.mask_folder, named)
    return [replace(each, mask=masks.get(each.image, each.mask)) for each in listed]
