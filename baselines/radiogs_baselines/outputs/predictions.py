"""The predictions that a folder holds of a scene: files by view and map.

A stored map is turned into numbers with the right part, colour space and ground.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor

from radiogs_core.errors import DataError
from radiogs_core.scene.colour import srgb_decode
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene, View
from radiogs_datasets.bounded_reading import as_float32, read_numpy
from radiogs_datasets.image_files import read_image

from .files import Found


@dataclass(frozen=True)
class Predictions:
    """Files by view and map; they are read when asked for.

    ``maps[view][map]`` and ``relit[light][view]`` hold what is there. ``missing`` names what belongs to a map that
    other views have; ``absent`` maps and lights that no view has, each with an example of the file looked for;
    ``ignored`` what is there and not read, with the reason where it has one; ``remarks`` what one must know before
    reading a score.
    """

    folder: Path
    code: str
    maps: Mapping[str, Mapping[str, Found]]
    relit: Mapping[str, Mapping[str, Found]]
    light: Path | None
    missing: tuple[str, ...]
    absent: tuple[str, ...]
    ignored: tuple[str, ...]
    remarks: tuple[str, ...]

    @property
    def files(self) -> dict[str, dict[str, str]]:
        """Paths relative to the folder: by map and view, then by ``relit/<light>`` and view, then the light."""
        named: dict[str, dict[str, str]] = {}
        for view, maps in self.maps.items():
            for name, found in maps.items():
                named.setdefault(name, {})[view] = self._relative(found.path)
        for light, views in self.relit.items():
            named[f"relit/{light}"] = {view: self._relative(found.path) for view, found in views.items()}
        if self.light is not None:
            named["environment"] = {"": self._relative(self.light)}
        return named

    def read(self, view: View, coverage: Float[Tensor, "height width 1"]) -> dict[str, Tensor]:
        """Every map of a view as it appears on black. Raises DataError (see ``read_map``)."""
        files = self.maps[view.name]
        alpha = {"alpha": read_map(files["alpha"], view, coverage)} if "alpha" in files else {}
        own = alpha.get("alpha", coverage)
        others = {name: read_map(found, view, coverage, own) for name, found in files.items() if name != "alpha"}
        return others | alpha

    def read_relit(
        self, light: str, view: View, coverage: Float[Tensor, "height width 1"]
    ) -> Float[Tensor, "height width 3"]:
        """The view under another light, display sRGB on black."""
        return read_map(self.relit[light][view.name], view, coverage)

    def read_light(self) -> EnvironmentMap | None:
        """The recovered light, if the folder has it. Raises DataError for a damaged file."""
        return None if self.light is None else read_environment(self.light)

    def _relative(self, path: Path) -> str:
        return path.relative_to(self.folder).as_posix()


def relightable(scene: Scene) -> dict[str, list[View]]:
    """The test views that the scene gives under each light."""
    lit = {light: [view for view in scene.test if view.has(f"relit/{light}")] for light in scene.lights}
    return {light: views for light, views in lit.items() if views}


AS_NUMBERS = (".exr", ".npy")
"""Files whose normals and radiance are stored as they are, not encoded for display."""

NO_DIRECTION = 3**0.5 / 255
"""A zero normal is stored as grey, which 8 bits hold half a level too low or high: a length of sqrt(3) / 255."""


def read_map(
    found: Found,
    view: View,
    coverage: Float[Tensor, "height width 1"],
    alpha: Float[Tensor, "height width 1"] | None = None,
) -> Float[Tensor, "height width _"]:
    """The map as it appears on black, in the units of ``radiogs_core.scene.scene.MapName`` (normals in the world).

    ``coverage`` is the true one: it takes the white of the ground away, which leaves differences from a truth on white
    as they were. ``alpha`` is the predicted one, where there is a file of it: normals are zero outside. Raises
    DataError for a damaged file, one of another size than the view, or one with too few channels.
    """
    rule = found.rule
    stored = _part(found, _read(found.path), (view.camera.height, view.camera.width))
    channels = 1 if rule.encoding == "value" else 3
    if stored.shape[2] < channels and stored.shape[2] != 1:
        raise DataError(f"{found.path} has {stored.shape[2]} channels, {channels} are needed")
    values = stored[..., :channels].expand(-1, -1, channels)
    own = stored[..., 3:] if stored.shape[2] == 4 and rule.ground == "own coverage" else None
    numbers = found.path.suffix in AS_NUMBERS
    if rule.encoding == "normal":
        covered = own if own is not None else coverage if alpha is None else alpha
        return _directions(values, numbers) * (covered > 0)
    if rule.ground == "white":
        values = values - (1 - coverage)
        # An image keeps what is darker than its ground, so that a white ground can be put back as it was.
        values = values if rule.encoding == "display" else values.clamp(min=0)
    if own is not None:
        values = values * own
    if rule.encoding == "srgb" or (rule.encoding == "radiance" and not numbers):
        return srgb_decode(values)
    return values


def read_environment(path: Path) -> EnvironmentMap:
    """Recovered light, linear RGB, Z up, centre column towards +X. Raises DataError for a damaged or negative map."""
    radiance = torch.from_numpy(_read(path)[..., :3].copy())
    if radiance.shape[2] != 3 or bool((radiance < 0).any()):
        raise DataError(
            f"{path} is no map of light",
            "Three channels of radiance, none of it negative, are needed.",
            "Export it anew.",
        )
    return EnvironmentMap(radiance)


def _directions(stored: Tensor, numbers: bool) -> Tensor:
    """Unit directions; zero where the file holds none: grey, or black in a file of encoded normals."""
    directions = stored if numbers else 2 * stored - 1
    length = directions.norm(dim=-1, keepdim=True)
    none = (length == 0) if numbers else (length <= NO_DIRECTION * (1 + 1e-4)) | (stored == 0).all(-1, keepdim=True)
    return torch.where(none, 0.0, torch.nn.functional.normalize(directions, dim=-1))


def _part(found: Found, image: NDArray[np.float32], size: tuple[int, int]) -> Tensor:
    place, parts = found.rule.part
    height, width = image.shape[:2]
    if (height, width) != (size[0], parts * size[1]):
        raise DataError(
            f"{found.path} is {width} x {height} pixels",
            f"The scene's view is {size[1]} x {size[0]}"
            + (f", and {parts} images stand side by side in this file." if parts > 1 else "."),
            "Score results of the scene's resolution: a resized image is another image.",
        )
    return torch.from_numpy(image[:, place * size[1] : (place + 1) * size[1]].copy())


def _read(path: Path) -> NDArray[np.float32]:
    if path.suffix != ".npy":
        return read_image(path)
    values = read_numpy(path)
    if not np.issubdtype(values.dtype, np.floating) or values.ndim not in (2, 3) or not values.size:
        raise DataError(
            f"{path} is no image",
            f"It holds {values.dtype} of shape {values.shape}; finite floats [height, width(, channels)] are needed.",
        )
    return as_float32(path, np.atleast_3d(values))
