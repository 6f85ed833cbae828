"""A sparse model from its folder."""

from pathlib import Path

from radiogs_core.errors import DataError

from . import binary, text
from .model import SparseModel, require_sound

PARTS = ("cameras", "images", "points3D")
FOLDERS = ("sparse/0", "sparse")
"""Where a scene's model lies: as COLMAP's mapper numbers it, and as ``image_undistorter`` writes it."""


def find_model(folder: Path) -> Path | None:
    """The folder of a scene's sparse model."""
    places = (folder / place for place in FOLDERS)
    return next(
        (place for place in places if any((place / f"cameras.{end}").is_file() for end in ("bin", "txt"))), None
    )


def files_of(folder: Path) -> tuple[Path, Path, Path]:
    """Cameras, images and points: the binary files where all are there, else text. Raises DataError."""
    for end in ("bin", "txt"):
        cameras, images, points = (folder / f"{part}.{end}" for part in PARTS)
        if all(path.is_file() for path in (cameras, images, points)):
            return cameras, images, points
    raise DataError(
        f"cannot read the model in {folder}: it is incomplete",
        f"It needs {', '.join(PARTS)}, all as .bin or all as .txt.",
        "Copy the model again, or export it anew:  colmap model_converter",
    )


def read_model(folder: Path) -> SparseModel:
    """Read and check a model; which photo saw which point is left out. Raises DataError."""
    cameras, images, points = files_of(folder)
    kind = binary if cameras.suffix == ".bin" else text
    positions, colours = kind.read_points(points)
    model = SparseModel(kind.read_cameras(cameras), kind.read_images(images), positions, colours)
    require_sound(folder, model)
    return model
