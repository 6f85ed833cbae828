"""The predictions of a scene in a folder of results, by view and map.

Reading a map selects its part of the file, converts its colour space and removes a white ground.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
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
from radiogs_datasets.lights import latitude_longitude

from .files import Found
from .layout import Ground


@dataclass(frozen=True)
class Predictions:
    """The files of a scene's predictions; ``read`` and its siblings read them at each call."""

    folder: Path
    """Folder of the results."""
    code: str
    """Name of the layout, a key of ``CODES``."""
    maps: Mapping[str, Mapping[str, Found]]
    """Files by view and map."""
    relit: Mapping[str, Mapping[str, Found]]
    """Files of relit images, by light and view."""
    light: Path | None
    """File of the recovered light; None if the folder has none."""
    missing: tuple[str, ...]
    """Files of single views that are missing, for maps that other views have."""
    absent: tuple[str, ...]
    """Maps and lights that no view has, each with the paths that were tried."""
    ignored: tuple[str, ...]
    """Files that are there but not read, with the reason if it is known."""
    remarks: tuple[str, ...]
    """Sentences on the layout that matter for its scores."""
    ground: Ground | None = None
    """The ground given in place of the layout's; None if none was given."""

    @property
    def files(self) -> dict[str, dict[str, str]]:
        """Paths relative to the folder, by map (or ``relit/<light>``, or ``environment``) and view."""
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
        """All maps of a view, on black. ``coverage``: true coverage. Raises DataError (see ``read_map``)."""
        files = self.maps[view.name]
        alpha = {"alpha": read_map(files["alpha"], view, coverage)} if "alpha" in files else {}
        own = alpha.get("alpha", coverage)
        others = {name: read_map(found, view, coverage, own) for name, found in files.items() if name != "alpha"}
        return others | alpha

    def read_one(
        self, name: str, view: View, coverage: Float[Tensor, "height width 1"]
    ) -> Float[Tensor, "height width _"]:
        """One map of a view, or ``relit/<light>``, as ``read`` and ``read_relit`` give it."""
        if name.startswith("relit/"):
            return self.read_relit(name.removeprefix("relit/"), view, coverage)
        files = self.maps[view.name]
        own = read_map(files["alpha"], view, coverage) if "alpha" in files and name == "normal" else coverage
        return read_map(files[name], view, coverage, own)

    def on_white(self, name: str, view: View) -> bool:
        """Whether a white ground is taken away where a map of colours, or ``relit/<light>``, is read."""
        light = name.removeprefix("relit/")
        found = self.maps[view.name][name] if light == name else self.relit[light][view.name]
        return found.rule.ground in ("white", "own coverage or white")

    def on_ground(self, ground: Ground) -> "Predictions":
        """The same with all maps of colours and values, but coverage and depth, on this ground.

        A file with a fourth channel keeps its meaning where the layout reads coverage from it.
        """

        maps, relit = (
            {key: {name: _on(ground, found) for name, found in files.items()} for key, files in every.items()}
            for every in (self.maps, self.relit)
        )
        remark = f"colours are read on a {ground} ground (--ground)"
        return replace(self, maps=maps, relit=relit, remarks=(*self.remarks, remark), ground=ground)

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


def _on(ground: Ground, found: Found) -> Found:
    """The file, read on another ground."""
    rule = found.rule
    if rule.map in ("alpha", "depth", "normal"):
        return found
    if rule.ground.startswith("own coverage"):
        ground = "own coverage or white" if ground == "white" else "own coverage"
    return replace(found, rule=replace(rule, ground=ground))


def relightable(scene: Scene) -> dict[str, list[View]]:
    """The test views for which the scene has an image under each light."""
    lit = {light: [view for view in scene.test if view.has(f"relit/{light}")] for light in scene.lights}
    return {light: views for light, views in lit.items() if views}


AS_NUMBERS = (".exr", ".npy")
"""Suffixes of files that store normals and radiance as floating-point values, not encoded for display."""

NO_DIRECTION = 3**0.5 / 255
"""Length of a zero normal after 8-bit encoding: grey is half a level too low or too high in each channel."""


def read_map(
    found: Found,
    view: View,
    coverage: Float[Tensor, "height width 1"],
    alpha: Float[Tensor, "height width 1"] | None = None,
) -> Float[Tensor, "height width _"]:
    """A map on black, in the units of ``radiogs_core.scene.scene.MapName`` (normals in the world).

    ``coverage``: true coverage, with which a white ground is removed, which preserves the difference from a truth on
    white. ``alpha``: predicted coverage, if there is a file of it: normals outside it are zero. Raises DataError for a
    file that is damaged, has another size than the view, or has too few channels.
    """
    rule = found.rule
    stored = _part(found, _read(found.path), (view.camera.height, view.camera.width))
    channels = 1 if rule.encoding == "value" else 3
    if stored.shape[2] < channels and stored.shape[2] != 1:
        raise DataError(f"{found.path} has {stored.shape[2]} channels, {channels} are needed")
    values = stored[..., :channels].expand(-1, -1, channels)
    own = stored[..., 3:] if stored.shape[2] == 4 and rule.ground.startswith("own coverage") else None
    numbers = found.path.suffix in AS_NUMBERS
    if rule.encoding == "normal":
        covered = own if own is not None else coverage if alpha is None else alpha
        return _directions(values, numbers) * (covered > 0)
    if rule.ground == "white" or (rule.ground == "own coverage or white" and own is None):
        values = values - (1 - coverage)
        # Images keep negative values (darker than their ground), so that a white ground can be restored exactly.
        values = values if rule.encoding == "display" else values.clamp(min=0)
    if own is not None:
        values = values * own
    if rule.encoding == "srgb" or (rule.encoding == "radiance" and not numbers):
        return srgb_decode(values)
    return values


def read_environment(path: Path) -> EnvironmentMap:
    """The recovered light: linear RGB, Z up, centre column towards +X.

    Raises DataError for a damaged or negative map, and for one that is not twice as wide as high.
    """
    radiance = torch.from_numpy(_read(path)[..., :3].copy())
    if radiance.shape[2] != 3 or bool((radiance < 0).any()):
        raise DataError(
            f"{path} is not a light map",
            "A light map has three channels of radiance, and no negative value.",
            "Export it again.",
        )
    return EnvironmentMap(latitude_longitude(path, radiance)[0])


def _directions(stored: Tensor, numbers: bool) -> Tensor:
    """Unit normals; zero where the file has none: zero, or grey or black in a file of encoded normals."""
    directions = stored if numbers else 2 * stored - 1
    length = directions.norm(dim=-1, keepdim=True)
    none = (length == 0) if numbers else (length <= NO_DIRECTION * (1 + 1e-4)) | (stored == 0).all(-1, keepdim=True)
    return torch.where(none, 0.0, torch.nn.functional.normalize(directions, dim=-1))


def _part(found: Found, image: NDArray[np.float32], size: tuple[int, int]) -> Tensor:
    index, parts = found.rule.part
    height, width = image.shape[:2]
    if (height, width) != (size[0], parts * size[1]):
        raise DataError(
            f"{found.path} is {width} x {height} pixels",
            f"The scene's view is {size[1]} x {size[0]}"
            + (f", and {parts} images are side by side in this file." if parts > 1 else "."),
            "Score results of the scene's resolution: resizing an image would change its metrics.",
        )
    return torch.from_numpy(image[:, index * size[1] : (index + 1) * size[1]].copy())


def _read(path: Path) -> NDArray[np.float32]:
    if path.suffix != ".npy":
        return read_image(path)
    values = read_numpy(path)
    if not np.issubdtype(values.dtype, np.floating) or values.ndim not in (2, 3) or not values.size:
        raise DataError(
            f"{path} is not an image",
            f"It has the type {values.dtype} and the shape {values.shape}; an image is [height, width(, channels)] of"
            " finite floating-point numbers.",
        )
    return as_float32(path, np.atleast_3d(values))
