"""Writing maps as a public code writes them: the inverse of ``reading``, by the same rules."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.colour import srgb_encode
from radiogs_core.scene.scene import Scene, View
from radiogs_datasets.image_files import write_png

from .codes import CODES
from .rules import Rule

Maps = Mapping[str, Float[Tensor, "height width _"]]


@dataclass(frozen=True)
class LayoutWriter:
    """Writes a scene's test views into ``folder`` in the layout of ``code``, as PNG files of 8 or 16 bits.

    Maps are those of ``radiogs_core.scene.scene.MapName`` on black: images in display sRGB, albedo, indirect and
    incident light linear, normals in the world. What a layout has no place for is left out; parts of a file that it
    fills with other things, such as the truth, are black. Folders that it numbers by iterations have the number 0.
    Every view has a file of its own, whatever the code would call it.
    """

    folder: Path
    code: str
    scene: Scene
    bits: int = 8
    written: list[Path] = field(default_factory=list)

    def write(self, view: View, maps: Maps, coverage: Float[Tensor, "height width 1"]) -> None:
        """Write the maps of a view under its own light. ``coverage``: stands for alpha where there is none."""
        rules = _first_of_each_map(CODES[self.code].rules)
        for path, parts in groupby(sorted(rules, key=lambda rule: rule.path), key=lambda rule: rule.path):
            together = [rule for rule in parts if rule.map in maps]
            if together:
                parts_of_file = [(rule, maps[rule.map]) for rule in together]
                self._file(path, view, parts_of_file, maps.get("alpha", coverage))

    def write_relit(self, light: str, view: View, maps: Maps, coverage: Float[Tensor, "height width 1"]) -> None:
        """Write a view under another light: the map ``image``, as ``write`` does."""
        rule = CODES[self.code].relit[0]
        self._file(rule.path, view, [(rule, maps["image"])], maps.get("alpha", coverage), light)

    def _file(self, path: str, view: View, parts: list[tuple[Rule, Tensor]], alpha: Tensor, light: str = "") -> None:
        count = parts[0][0].part[1]
        encoded = {rule.part[0]: encode(rule, image, alpha) for rule, image in parts}
        channels = max(part.shape[2] for part in encoded.values())
        height, width = alpha.shape[:2]
        whole = torch.zeros(height, count * width, channels)
        for place, part in encoded.items():
            whole[:, place * width : (place + 1) * width] = part
        named = path.replace("*", "0").format(
            index=self._place[view.name], name=view.name.replace("/", "_"), light=light
        )
        file = self.folder / (named if named.endswith(".png") else f"{named}.png")
        file.parent.mkdir(parents=True, exist_ok=True)
        write_png(file, whole.numpy(), self.bits)
        self.written.append(file)

    @property
    def _place(self) -> dict[str, int]:
        return {view.name: place for place, view in enumerate(self.scene.test)}


def encode(
    rule: Rule, image: Float[Tensor, "height width _"], alpha: Float[Tensor, "height width 1"]
) -> Float[Tensor, "height width _"]:
    """The values of a file before they are clipped to [0, 1] and rounded; ``image`` is on black, ``alpha`` its own.

    ``predictions.read_map`` reads them as ``image``. On white it takes away the white beside the *true* coverage: the
    difference from the truth is then that of both on white, which is how such a code compares them.
    """
    if rule.encoding == "normal":
        return image / 2 + 0.5
    stored = srgb_encode(image) if rule.encoding in ("srgb", "radiance") else image
    return stored + (1 - alpha) if rule.ground == "white" else stored


def _first_of_each_map(rules: tuple[Rule, ...]) -> list[Rule]:
    """The rule that a map is read by where a folder holds all of them."""
    first: dict[str, Rule] = {}
    for rule in rules:
        first.setdefault(rule.map, rule)
    return list(first.values())
