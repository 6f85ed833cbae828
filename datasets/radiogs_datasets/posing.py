"""Camera poses of photographs that have none, by COLMAP's structure from motion (extra ``poses``).

Features (SIFT, on the CPU) and matches are kept in a hidden folder beside the photos, named by the content of photos
and masks, until the model is complete: a killed run continues from them. Photos of one size share a camera.
"""

import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import combinations, count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import cv2
import numpy as np

from radiogs_core.errors import DataError

from .image_structure import Header
from .layouts.masks import masks_of, read_mask
from .layouts.photos import images_in, inspect_photos
from .writing import made_beside, require_new

Matching = Literal["auto", "exhaustive", "sequential"]
"""Which pairs of photos are matched: all, or neighbours in the order of names (for a video or a walk)."""

MOST_EXHAUSTIVE = 100
"""Largest number of photos for which ``auto`` matches all pairs (4,950 pairs)."""

FEWEST = 3
NEAR, PAIRS = 10, 50
"""Number of next photos that ``sequential`` matches with each one, besides photos at powers of two; and pairs per
batch, the most that a killed run has to repeat."""

SEED = 0
"""Seed of every random sampling consensus."""


@dataclass(frozen=True)
class Posed:
    """The largest model of joined photos, which lies in sparse/0 of ``scene``."""

    scene: Path
    masks: Path | None
    photos: int
    unregistered: tuple[str, ...]
    """Names of the photos without a pose."""
    points: int
    error: float
    """Mean reprojection error, pixels."""
    others: tuple[int, ...]
    """Numbers of photos in models that could not be joined with it; they are not kept."""


@dataclass(frozen=True)
class _Work:
    """The photos of a model, and the folder in which it is made."""

    colmap: Any
    """The module ``pycolmap``."""
    photos: Mapping[str, Path]
    """Photos by their names in COLMAP, which are numbers, because it reads pairs of names without spaces."""
    kept: Path
    threads: int
    advance: Callable[[str, int, int], None]

    @property
    def database(self) -> Path:
        """COLMAP's database: cameras, features and matches."""
        return self.kept / "database.db"


def pose_photos(
    photos: Path,
    colmap: Any,
    matching: Matching,
    mask_folder: Path | None,
    threads: int,
    advance: Callable[[str, int, int], None],
) -> Posed:
    """Write COLMAP's model of the photos of a folder to sparse/0 beside them.

    ``photos``: a folder of photos, or one that has them in images/. ``colmap``: the module ``pycolmap``.
    ``mask_folder``: no feature lies where its masks are black (default: masks/ beside the photos, if there is one).
    ``advance(task, done, total)``. Raises UsageError where sparse/ exists, DataError for fewer than three photos, for
    photos and masks that cannot be read, and where no two photos can be joined.
    """
    scene, paths = _scene_of(photos.absolute())
    beside = scene / "masks" if (scene / "masks").is_dir() else None
    folder = mask_folder or beside
    masks = masks_of(None if folder is None else str(folder), ((path.name, path) for path in paths))
    headers, checksum = inspect_photos(paths[0].parent, paths, masks)
    numbered = {f"{index:06d}{path.suffix}": path for index, path in enumerate(paths)}
    work = _Work(colmap, numbered, scene / f".poses-{checksum[:12]}", threads, advance)
    colmap.logging.minloglevel = int(colmap.logging.FATAL)
    with _failures_explained(work):
        _lay_out(work, headers, masks)
        _extract(work, bool(masks))
        _match(work, matching)
        largest, *others = _mapped(work)
    with made_beside(scene / "sparse") as made:
        (made / "0").mkdir()
        largest.write(made / "0")
    shutil.rmtree(work.kept)
    registered = {largest.images[number].name for number in largest.reg_image_ids()}
    lost = tuple(each.name for each in paths if each.name not in registered)
    found = largest.num_points3D(), largest.compute_mean_reprojection_error()
    return Posed(scene, folder, len(paths), lost, *found, tuple(each.num_reg_images() for each in others))


def _scene_of(place: Path) -> tuple[Path, list[Path]]:
    """The folder that sparse/ is made in, and the photos. Raises UsageError and DataError as ``pose_photos`` does."""
    images = place / "images" if (place / "images").is_dir() else place
    scene, paths = images.parent if images.name == "images" else images, images_in(images)
    require_new(scene / "sparse")
    if len(paths) < FEWEST:
        found = f"{images} has {len(paths)} photo{'s' * (len(paths) != 1)}"
        raise DataError(
            found if images.is_dir() else f"there is no folder {images}",
            f"Poses and points follow from at least {FEWEST} photos of one scene.",
            "Give the folder that holds the photos themselves, as .jpg or .png (convert .heic), not one above it.",
        )
    return scene, paths


def _lay_out(work: _Work, headers: Mapping[Path, Header], masks: Mapping[Path, Path]) -> None:
    """Link the photos, write their masks, and give every photo its number and camera, always in the same order."""
    colmap, sizes = work.colmap, dict[tuple[int, int], list[str]]()
    for folder in ("photos", "masks"):
        (work.kept / folder).mkdir(parents=True, exist_ok=True)
    for name, photo in work.photos.items():
        link = work.kept / "photos" / name
        if not link.is_symlink():
            link.symlink_to(photo)
        if photo in masks:
            levels = np.rint(255 * read_mask(masks[photo]).numpy()).astype(np.uint8)
            cv2.imwrite(str(work.kept / "masks" / f"{name}.png"), levels)
        sizes.setdefault(headers[photo].size, []).append(name)
    if not work.database.exists():
        made = work.kept / "made.db"
        made.unlink(missing_ok=True)
        colmap.Database.open(made).close()
        for names in sizes.values():
            colmap.import_images(made, work.kept / "photos", colmap.CameraMode.SINGLE, image_names=names)
        made.rename(work.database)


def _extract(work: _Work, masked: bool) -> None:
    """Find the features of every photo; COLMAP skips photos that have features."""
    colmap, names = work.colmap, list(work.photos)
    reader = colmap.ImageReaderOptions(mask_path=work.kept / "masks" if masked else "")
    options = colmap.FeatureExtractionOptions(num_threads=work.threads)
    for done in range(0, len(names), work.threads):
        work.advance("features", done, len(names))
        colmap.extract_features(
            work.database, work.kept / "photos", names[done : done + work.threads], colmap.CameraMode.AUTO, reader,
            options, colmap.Device.cpu,
        )  # fmt: skip
    work.advance("features", len(names), len(names))


def _match(work: _Work, matching: Matching) -> None:
    """Match the features of pairs of photos; COLMAP skips matched pairs."""
    colmap, names, listed = work.colmap, list(work.photos), work.kept / "pairs.txt"
    verification = colmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = SEED
    pairs = pairs_of(len(names), matching)
    for done in range(0, len(pairs), PAIRS):
        work.advance("matches", done, len(pairs))
        listed.write_text("".join(f"{names[one]} {names[other]}\n" for one, other in pairs[done : done + PAIRS]))
        colmap.match_image_pairs(
            work.database, colmap.FeatureMatchingOptions(num_threads=work.threads),
            colmap.ImportedPairingOptions(match_list_path=listed), verification, colmap.Device.cpu,
        )  # fmt: skip
    work.advance("matches", len(pairs), len(pairs))


def pairs_of(photos: int, matching: Matching) -> list[tuple[int, int]]:
    """The pairs of photos that are matched, by indices in the order of names.

    ``sequential``: each photo with the ``NEAR`` next ones, and with the ones 16, 32, 64, ... places later.
    """
    if matching == "exhaustive" or (matching == "auto" and photos <= MOST_EXHAUSTIVE):
        return list(combinations(range(photos), 2))
    steps = {*range(1, NEAR + 1), *(1 << power for power in range(4, photos.bit_length()))}
    return [(first, first + step) for first in range(photos) for step in sorted(steps) if first + step < photos]


def _mapped(work: _Work) -> list[Any]:
    """The models that the photos can be joined to, the one with the most photos first. Raises DataError without any.

    One thread and one seed: sums of several threads differ in their last digits, and so do models.
    """
    colmap, joined, photos = work.colmap, count(1), len(work.photos)
    options = colmap.IncrementalPipelineOptions(num_threads=1, random_seed=SEED)
    options.mapper.random_seed = options.triangulation.random_seed = SEED
    with TemporaryDirectory(dir=work.kept) as written:
        models = colmap.incremental_mapping(
            work.database, work.kept / "photos", written, options,
            next_image_callback=lambda: work.advance("poses", min(next(joined), photos - 1), photos),
        ).values()  # fmt: skip
    if not models:
        raise DataError(
            f"the {photos} photos could not be joined to a model",
            "No two of them show enough of the same points from places that are far enough apart.",
            "Take photos with more overlap and texture from a moving camera; with masks, try without them.",
        )
    for model in models:
        for image in model.images.values():
            image.name = work.photos[image.name].name
    return sorted(models, key=lambda model: (-model.num_reg_images(), -model.num_points3D()))


@contextmanager
def _failures_explained(work: _Work) -> Iterator[None]:
    """Raise DataError where COLMAP fails, such as by a damaged database, or its folder cannot be written."""
    try:
        yield
    except (RuntimeError, ValueError, OSError) as error:
        raise DataError(
            f"poses cannot be found: {error!s:.300}",
            f"COLMAP says so, or the system; they work in {work.kept}.",
            "Make room there, or remove that folder; then start again.",
        ) from error
