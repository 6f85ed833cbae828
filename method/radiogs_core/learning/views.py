"""The training views a stage learns from, and the order in which it sees them.

Their pixels are held in as little memory as keeps every bit of them: as the whole numbers that image files store.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import torch
from jaxtyping import Float, Integer
from torch import Tensor

from ..errors import DataError
from ..scene.camera import Camera
from ..scene.scene import Scene, View

DEPTHS: tuple[tuple[int, torch.dtype], ...] = ((255, torch.uint8), (65_535, torch.uint16))
"""Largest level of PNG's depths, and what holds one."""


@dataclass(frozen=True)
class Levels:
    """Pixels as levels of an image file; ``most`` stands for 1."""

    levels: Integer[Tensor, "*shape"]
    most: int

    def values(self) -> Float[Tensor, "*shape"]:
        """The pixels in [0, 1], bit for bit as they were."""
        table = _values(self.most).to(self.levels.device)
        return table.index_select(0, self.levels.flatten().int()).view(self.levels.shape)


@dataclass(frozen=True)
class Whole:
    """Pixels that are levels of no file, such as those of a reduced image: float32."""

    pixels: Float[Tensor, "*shape"]

    def values(self) -> Float[Tensor, "*shape"]:
        """The pixels."""
        return self.pixels


def held(pixels: Float[Tensor, "*shape"], device: torch.device) -> Levels | Whole:
    """Pixels on a device: one or two bytes a value where they are levels of 8 or 16 bits, else four."""
    for most, dtype in DEPTHS:
        levels = (pixels * most).round().clamp(0, most).int()
        if torch.equal(_values(most).index_select(0, levels.flatten()).view(pixels.shape), pixels):
            return Levels(levels.to(dtype).to(device), most)
    return Whole(pixels.to(device))


def bytes_of(pixels: Levels | Whole) -> int:
    """Bytes that they take."""
    kept = pixels.levels if isinstance(pixels, Levels) else pixels.pixels
    return kept.numel() * kept.element_size()


@cache
def _values(most: int) -> Float[Tensor, " levels"]:
    """What each level stands for, as the readers of image files compute it; divided on the CPU alone, because a GPU
    multiplies by the reciprocal."""
    return torch.arange(most + 1, dtype=torch.float32) / most


HELD_BYTES = 2 * 2**30
"""Memory that a stage's training views may take: 180 views of 1560 x 1040 take 0.9 GB as bytes. What is beyond is read
from its files whenever its turn comes."""


@dataclass(frozen=True)
class TrainingView:
    """One training view on the device: camera, straight display-sRGB image and coverage.

    ``view``: where the pixels come from. ``pixels`` and ``covered``: the image and its coverage where they are held;
    ``pixels`` is None for a view that is read each time, ``covered`` for one that is covered everywhere, too.
    """

    camera: Camera
    view: View
    pixels: Levels | Whole | None
    covered: Levels | Whole | None

    @property
    def image(self) -> Float[Tensor, "height width 3"]:
        """Straight display sRGB."""
        if self.pixels is None:
            return self.view.read("image").to(self.device)
        return self.pixels.values()

    @property
    def mask(self) -> Float[Tensor, "height width"]:
        """Coverage; 1 everywhere for a view without alpha."""
        if self.covered is not None:
            return self.covered.values()
        if self.view.has("alpha"):
            return self.view.read("alpha")[..., 0].to(self.device)
        return torch.ones(self.camera.height, self.camera.width, device=self.device)

    @property
    def device(self) -> torch.device:
        """Where it is looked at."""
        return self.camera.camera_to_world.device

    def over(self, background: float) -> Float[Tensor, "height width 3"]:
        """The image composited on a grey background, in display sRGB (as every splatting code does)."""
        mask = self.mask[..., None]
        return self.image * mask + background * (1 - mask)

    def decoded(self) -> "TrainingView":
        """The view with its pixels as numbers, for a step that looks at them several times."""
        return replace(self, pixels=Whole(self.image), covered=Whole(self.mask))

    def reread(self) -> View:
        """The view with the maps that are held in the place of files, on the CPU."""
        sources = {"image": lambda: self.image.cpu()}
        if self.view.has("alpha"):
            sources["alpha"] = lambda: self.mask.cpu()[..., None]
        return replace(self.view, sources=sources)


def chosen_views(scene: Scene, share: float, seed: int) -> tuple[View, ...]:
    """A seeded random subset of the training views: ceil(share * count) of them, at least one."""
    if not scene.train:
        raise DataError(f"scene '{scene.name}' has no training views", "Nothing can be learnt from it.")
    count = max(1, -int(-len(scene.train) * share // 1))
    order = torch.randperm(len(scene.train), generator=torch.Generator().manual_seed(seed))
    return tuple(scene.train[int(place)] for place in order[:count].sort().values)


def load(views: Sequence[View], device: torch.device, most: int = HELD_BYTES) -> tuple[TrainingView, ...]:
    """The views on a device, every one read once. A view without alpha is covered everywhere.

    They are held in the depth of their files, up to ``most`` bytes in all; the others are read again when asked for.
    """
    loaded = []
    for view in views:
        camera = view.camera.to(device, torch.float32)
        pixels = held(view.read("image"), device)
        covered = held(view.read("alpha")[..., 0], device) if view.has("alpha") else None
        needed = bytes_of(pixels) + (bytes_of(covered) if covered is not None else 0)
        kept = (pixels, covered) if needed <= most else (None, None)
        most -= needed if needed <= most else 0
        loaded.append(TrainingView(camera, view, *kept))
    return tuple(loaded)


def view_at(views: tuple[TrainingView, ...], iteration: int, seed: int) -> TrainingView:
    """The view of an iteration, decoded: each epoch is a fresh permutation, a function of seed and epoch alone."""
    epoch, place = divmod(iteration, len(views))
    generator = torch.Generator().manual_seed(seed * 1_000_003 + epoch)
    return views[int(torch.randperm(len(views), generator=generator)[place])].decoded()


def mean_distance(views: tuple[TrainingView, ...], centre: Float[Tensor, "3"]) -> float:
    """Mean distance of the cameras from the scene's centre, world units."""
    return float(torch.stack([(view.camera.centre.cpu().double() - centre).norm() for view in views]).mean())
