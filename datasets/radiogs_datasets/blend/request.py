"""A request to render a .blend file into a scene."""

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path

from radiogs_core.errors import DataError, UsageError

from ..layouts.tensoir import TRAINING_LIGHT

LIGHT_FILES = (".hdr", ".exr")
SCHEMA = 1


@dataclass(frozen=True)
class Request:
    """A .blend file, and how it is rendered.

    ``cameras``: "published", "fit" (``cameras``), or a folder with transforms files; ``train`` and ``test``: numbers of
    views of published and fitted cameras. ``size``: pixels a side; ``samples`` a pixel, ``test_samples`` in test views
    (0: as many); ``bounces`` after the first surface. ``lights``: a folder of .hdr and .exr maps (lat-long, Z up,
    linear), of which ``training_light`` (a file's name without its ending; None: "training", or else the first in
    order) lights the training views, and the others the relit ones. ``device``: "cpu" or "cuda". ``keep_passes``:
    whether every pass that Cycles wrote of the test views is kept.
    """

    file: Path
    lights: Path
    training_light: str | None = None
    cameras: str = "published"
    train: int = 100
    test: int = 20
    size: int = 400
    samples: int = 256
    test_samples: int = 0
    bounces: int = 12
    seed: int = 0
    device: str = "cpu"
    keep_passes: bool = False

    @cached_property
    def light_files(self) -> Mapping[str, Path]:
        """The maps by name, the training light's first. Raises UsageError for a folder without maps, or two maps with
        the same name, or without the training light.
        """
        found: dict[str, Path] = {}
        for path in sorted(self.lights.iterdir() if self.lights.is_dir() else []):
            if path.suffix.lower() in LIGHT_FILES:
                if path.stem in found:
                    raise UsageError(
                        f"{path} and {found[path.stem].name} have one name",
                        "Relit images are named after their light.",
                        "Rename one of them.",
                    )
                found[path.stem] = path
        if not found:
            raise UsageError(
                f"{self.lights} holds no light",
                "Lights are .hdr or .exr maps: latitude and longitude, linear RGB, Z up.",
                "Give a folder of such files.",
            )
        first = self.training_light or (TRAINING_LIGHT if TRAINING_LIGHT in found else next(iter(found)))
        if first not in found:
            raise UsageError(f"no light '{first}' in {self.lights}", "", f"Lights: {', '.join(found)}.")
        return {first: found[first], **{name: path for name, path in found.items() if name != first}}

    def identity(self) -> dict[str, object]:
        """Everything that affects the pictures: two requests with equal identities make the same scene."""
        return {
            "schema": SCHEMA,
            **{name: value for name, value in asdict(self).items() if name not in ("file", "lights", "cameras")},
            "file": digest(self.file),
            "cameras": {path.name: digest(path) for path in self.camera_files()} or self.cameras,
            "lights": {name: digest(path) for name, path in self.light_files.items()},
        }

    def camera_files(self) -> list[Path]:
        """The transforms files of the given cameras; none for cameras by name."""
        if self.cameras in ("published", "fit"):
            return []
        return [Path(self.cameras) / f"transforms_{split}.json" for split in ("train", "test")]


def digest(path: Path) -> str:
    """SHA-256 of a file's content. Raises DataError for one that cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise DataError(f"cannot read {path}", f"The system says: {error.strerror}.", "Give a file.") from error
