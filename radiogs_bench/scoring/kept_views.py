"""Maps of the test views as codes of 8 bits, kept with a result so that reports show every view and light."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.colour import srgb_encode
from radiogs_core.scene.scene import Scene, View

from .score_maps import truth

MAPS = ("image", "albedo", "normal", "roughness", "depth", "indirect")
"""Maps that are kept of a view, beside its relit images."""

KEPT_BYTES = 128 * 2**20
"""Codes of a cell, before compression, if no number of views is asked for: predictions and truth together."""

CHANNELS = 14
"""Channels of all ``MAPS`` together."""

MARGIN = 0.1
"""The range of depths is wider than that of the true ones by this share of it, on both sides."""

Image = Float[Tensor, "height width channels"]
Grey = Float[Tensor, "height width 1"]


@dataclass
class KeptViews:
    """The codes of chosen views: uint8 [height, width, channels] by ``views/<number>/<side>/<map>``.

    ``number`` is that of the view among ``names``, ``side`` is ``render`` or ``truth``; relit images are
    ``relit/<light>``. Images are in display sRGB, albedo and indirect light are encoded in sRGB, normals are
    (n + 1) / 2 with 0 0 0 where there is no surface, depth is 255 in front to 1 at the back and 0 where nothing is
    seen, over one range for all who render the view.
    """

    names: Sequence[str]
    chosen: frozenset[str]
    extent: float
    codes: dict[str, np.ndarray] = field(default_factory=dict)

    def rendered(self, view: View, maps: Mapping[str, Tensor]) -> None:
        """Keep maps of a view and the truth of them, if the view is among the chosen; albedo as it is aligned."""
        for name in MAPS if view.name in self.chosen else ():
            if name in maps:
                self._keep(view, "render", name, self._shown(view, name, maps[name], maps.get("alpha")))
                if view.has(name):
                    self._keep(view, "truth", name, self._shown(view, name, truth(view, name), None))

    def relit(self, view: View, light: str, image: Image, target: Image) -> None:
        """Keep a relit image, in display sRGB, and the true one."""
        if view.name in self.chosen:
            self._keep(view, "render", f"relit/{light}", image)
            self._keep(view, "truth", f"relit/{light}", target)

    def _keep(self, view: View, side: str, name: str, shown: Image) -> None:
        finite = torch.where(shown.isfinite(), shown, 0.0)  # maps may have no value where nothing is
        codes = (255 * finite.clamp(0, 1)).round().to(torch.uint8)
        self.codes[f"views/{self.names.index(view.name)}/{side}/{name}"] = codes.cpu().numpy()

    def _shown(self, view: View, name: str, image: Image, alpha: Grey | None) -> Image:
        if name in ("albedo", "indirect"):
            return srgb_encode(image)
        if name == "normal":
            return torch.where((image == 0).all(-1, keepdim=True), 0.0, image / 2 + 0.5)
        if name == "depth":
            return _depth_shown(image, alpha, depth_range(view, self.extent))
        return image


def _depth_shown(depth: Grey, alpha: Grey | None, within: tuple[float, float]) -> Grey:
    near, far = within
    seen = (depth > 0) if alpha is None else (depth > 0) & (alpha > 0.5)
    return torch.where(seen, (1 - (depth - near) / (far - near)).clamp(1 / 255, 1), 0.0)


def depth_range(view: View, extent: float) -> tuple[float, float]:
    """Depths shown in white and in black: those of the truth with a margin; without truth 0 to twice the extent."""
    if view.has("depth"):
        depth = truth(view, "depth")
        seen = depth[depth > 0]
        if len(seen) and float(seen.max()) > float(seen.min()):
            low, high = float(seen.min()), float(seen.max())
            return low - MARGIN * (high - low), high + MARGIN * (high - low)
    return 0.0, 2 * extent


def views_to_keep(scene: Scene, count: int | None) -> KeptViews:
    """At most so many views, evenly spread, the middle test view among them.

    None: as many as fit ``KEPT_BYTES``, at least one.
    """
    views = [*scene.test, *scene.relight]
    middle = len(scene.test) // 2
    if count is None:
        count = max(1, KEPT_BYTES // _bytes_of(views[middle], len(scene.lights)))
    count = min(count, len(views))
    chosen = frozenset(views[(middle + index * len(views) // count) % len(views)].name for index in range(count))
    return KeptViews([view.name for view in views], chosen, scene.extent)


def _bytes_of(view: View, lights: int) -> int:
    return 2 * (CHANNELS + 3 * lights) * view.camera.height * view.camera.width
