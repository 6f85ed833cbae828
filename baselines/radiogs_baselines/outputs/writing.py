"""Writes maps in the layout of a public code: the inverse of ``reading``, by the same rules."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.own_files import fresh
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.scene.scene import Scene, View
from radiogs_datasets.image_files import write_png

from .codes import CODES
from .layout import Rule

Maps = Mapping[str, Float[Tensor, "height width _"]]
"""Maps of a view by name."""


@dataclass(frozen=True)
class LayoutWriter:
    """Writes a scene's test views as PNG files in the layout of a public code.

    Maps are those of ``radiogs_core.scene.scene.MapName``, on black: images in display sRGB; albedo, indirect and
    incident light linear; normals in the world. Maps that a layout does not have are left out, and parts of a file that
    it fills with other images, such as the truth, are black. The number of an iteration in a folder's name is 0. Every
    view has its own file, also if the code would give several views the same name.
    """

    folder: Path
    """Folder to write into."""
    code: str
    """Name of the layout, a key of ``CODES``."""
    scene: Scene
    """Scene of the views."""
    bits: int = 8
    """Bits of a channel, 8 or 16."""
    written: list[Path] = field(default_factory=list)
    """Files that have been written."""

    def write(self, view: View, maps: Maps, coverage: Float[Tensor, "height width 1"]) -> None:
        """Write the maps of a view under its own light. ``coverage``: used if there is no map ``alpha``."""
        # A folder that has the files of all rules is read by the first rule of each map.
        rules = {rule.map: rule for rule in reversed(CODES[self.code].rules)}.values()
        for path, together in groupby(sorted(rules, key=lambda rule: rule.path), key=lambda rule: rule.path):
            if parts := [(rule, maps[rule.map]) for rule in together if rule.map in maps]:
                self._file(path, view, parts, maps.get("alpha", coverage))

    def write_relit(self, light: str, view: View, maps: Maps, coverage: Float[Tensor, "height width 1"]) -> None:
        """Write the map ``image`` of a view under another light; see ``write``."""
        rule = CODES[self.code].relit[0]
        self._file(rule.path, view, [(rule, maps["image"])], maps.get("alpha", coverage), light)

    def _file(self, path: str, view: View, parts: list[tuple[Rule, Tensor]], alpha: Tensor, light: str = "") -> None:
        count = parts[0][0].part[1]
        encoded = {rule.part[0]: encode(rule, image, alpha) for rule, image in parts}
        channels = max(part.shape[2] for part in encoded.values())
        height, width = alpha.shape[:2]
        whole = torch.zeros(height, count * width, channels)
        for index, part in encoded.items():
            whole[:, index * width : (index + 1) * width] = part
        index = [each.name for each in self.scene.test].index(view.name)
        named = path.replace("*", "0").format(index=index, name=view.name.replace("/", "_"), light=light)
        file = fresh(self.folder / (named if named.endswith(".png") else f"{named}.png"), self.folder)
        write_png(file, whole.numpy(), self.bits)
        self.written.append(file)


def encode(
    rule: Rule, image: Float[Tensor, "height width _"], alpha: Float[Tensor, "height width 1"]
) -> Float[Tensor, "height width _"]:
    """The values of a file before they are clipped to [0, 1] and rounded.

    This is the inverse of ``predictions.read_map``, for an ``image`` on black with its own coverage ``alpha``. That
    function removes a white ground with the *true* coverage, so the difference from the truth equals the difference of
    both on white, which such a code measures.
    """
    if rule.encoding == "normal":
        return image / 2 + 0.5
    stored = srgb_encode(image) if rule.encoding in ("srgb", "radiance") else image
    return stored + (1 - alpha) if rule.ground == "white" else stored
