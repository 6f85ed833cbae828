"""Injuries of a copied miniature: changes of its files that leave every header, size and name as it was."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radiogs_datasets.deep_check.colours import decoded, encoded
from radiogs_datasets.image_files import read_exr, read_hdr, read_image, write_exr, write_hdr, write_png

Image = NDArray[np.float32]


def rewrite(folder: Path, change: Callable[[dict[str, Any]], object]) -> None:
    """Change the fields of both transforms files."""
    for table in sorted(folder.glob("transforms_*.json")):
        content = json.loads(table.read_text())
        change(content)
        table.write_text(json.dumps(content))


def poses(folder: Path, change: Callable[[NDArray[np.float64]], NDArray[np.float64]], views: str = "") -> None:
    """Change the poses (camera to world, OpenGL axes) of the views whose path has some words in it."""

    def each(content: dict[str, Any]) -> None:
        for frame in content["frames"]:
            if views in frame["file_path"]:
                frame["transform_matrix"] = change(np.array(frame["transform_matrix"])).tolist()

    rewrite(folder, each)


def files(folder: Path, pattern: str, change: Callable[[Image], NDArray[Any]]) -> None:
    """Change the pixels of every file of a pattern, in its own format."""
    for path in sorted(folder.glob(pattern)):
        read, write = {
            ".png": (read_image, write_png), ".exr": (read_exr, write_exr), ".hdr": (read_hdr, write_hdr)
        }[path.suffix]  # fmt: skip
        write(path, np.ascontiguousarray(change(read(path)), dtype=np.float32))


def colour(change: Callable[[Image], NDArray[Any]]) -> Callable[[Image], NDArray[Any]]:
    """The change of the first three channels alone."""
    return lambda image: np.concatenate([change(image[..., :3]).clip(0, 1), image[..., 3:]], -1)


def coverage(change: Callable[[Image], NDArray[Any]]) -> Callable[[Image], NDArray[Any]]:
    """The change of the fourth channel alone, [height, width]."""
    return lambda image: np.concatenate([image[..., :3], change(image[..., 3])[..., None]], -1)


def exposed(*gains: float) -> Callable[[Image], NDArray[Any]]:
    """Linear colours times a gain for each channel."""
    return colour(lambda display: encoded(decoded(display.astype(float)) * np.array(gains)))


def swap(folder: Path, first: str, second: str) -> None:
    """Exchange two files."""
    one, other, aside = folder / first, folder / second, folder / "aside"
    one.rename(aside)
    other.rename(one)
    aside.rename(other)
