"""Where scenes in the TensoIR layout keep their environment maps.

Own scenes: ``<scene>/envmaps/<light>.hdr``, with ``training.hdr`` the training light where it is known. TensoIR's
archive: a folder ``Environment_Maps`` beside the scenes or one level up; ground truth was rendered under its 2k maps,
training images under ``sunset``.
"""

from collections.abc import Mapping, Set
from dataclasses import dataclass
from pathlib import Path

import torch

from radiogs_core.errors import DataError
from radiogs_core.scene.light import EnvironmentMap

from ..image_files import read_hdr
from ..lights import latitude_longitude

TRAINING_LIGHT = "training"
ARCHIVE_TRAINING_LIGHT = "sunset"
ARCHIVE_FOLDERS = ("Environment_Maps/high_res_envmaps_2k", "Environment_Maps/high_res_envmaps_1k")


@dataclass(frozen=True)
class LightFiles:
    """Maps for relighting by the light's name, and the training light's, where there is one."""

    relight: Mapping[str, Path]
    training: Path | None

    def files(self) -> dict[str, Path]:
        """Every map by the name it has in the scene, wherever it lies."""
        training = {TRAINING_LIGHT: self.training} if self.training is not None else {}
        return {f"envmaps/{light}.hdr": path for light, path in {**self.relight, **training}.items()}


def find_lights(folder: Path, relit: Set[str]) -> LightFiles:
    """The maps of a scene whose test views have images under the lights ``relit``.

    Raises DataError if the scene has maps of its own, but not for each of these lights. With no map anywhere the
    scene is still good for everything but relighting.
    """
    own = {path.stem: path for path in sorted((folder / "envmaps").glob("*.hdr"))}
    if not own:  # TensoIR's archive has the finer maps first; its rotated lights (sunset_120) have images but no map
        for archive in (parent / name for parent in (folder.parent, folder.parent.parent) for name in ARCHIVE_FOLDERS):
            found = {path.stem: path for path in sorted(archive.glob("*.hdr"))}
            if found:
                wanted = {light: path for light, path in found.items() if light in relit}
                return LightFiles(wanted, found.get(ARCHIVE_TRAINING_LIGHT))
        return LightFiles({}, None)
    if relit - own.keys():
        raise DataError(
            f"scene '{folder.name}' has no environment map for: {', '.join(sorted(relit - own.keys()))}",
            "Its test views have images under these lights; without the maps they cannot be relit.",
            f"Add {folder / 'envmaps'}/<light>.hdr, or remove the images rgba_<light>.png.",
        )
    training = own.pop(TRAINING_LIGHT, None)
    return LightFiles(own, training)


def read_light(path: Path) -> EnvironmentMap:
    """The stored map, taken as Z up (``radiogs_core.scene.light``).

    Raises DataError for a damaged file, and for one that is no latitude-longitude map.
    """
    return EnvironmentMap(latitude_longitude(path, torch.from_numpy(read_hdr(path)))[0])
