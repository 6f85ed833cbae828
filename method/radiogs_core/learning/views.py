"""The training views of a stage, and the order in which its steps use them.

Pixels are kept in memory as the integers that image files store, which loses nothing.
"""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import torch
from jaxtyping import Bool, Float, Int, Num
from torch import Tensor

from ..errors import DataError
from ..scene.camera import Camera
from ..scene.scene import Scene, View

DEPTHS: Mapping[torch.dtype, int] = {torch.uint8: 255, torch.uint16: 65_535}
"""Integer types of the pixels of 8-bit and 16-bit PNG files, and the level that represents 1."""


def in_memory(pixels: Float[Tensor, "*shape"], device: torch.device) -> Num[Tensor, "*shape"]:
    """Pixels in [0, 1] on a device: as levels in one or two bytes a value if all are levels of a file, else float32."""
    for dtype, most in DEPTHS.items():
        levels = (pixels * most).round().clamp(0, most).to(torch.int32).to(dtype)
        if torch.equal(values_of(levels), pixels):
            return levels.to(device)
    return pixels.to(device)


def values_of(kept: Num[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """The pixels that ``in_memory`` has stored, float32, bit for bit as the file's reader gives them."""
    if kept.dtype not in DEPTHS:
        return kept
    table = _values(DEPTHS[kept.dtype]).to(kept.device)
    return table.index_select(0, kept.flatten().int()).view(kept.shape)


@cache
def _values(most: int) -> Float[Tensor, " levels"]:
    """The value of each level, as the readers of image files compute it. The division runs on the CPU, because a GPU
    multiplies by the reciprocal."""
    return torch.arange(most + 1, dtype=torch.float32) / most


HELD_BYTES = 2 * 2**30
"""Largest memory of a stage's training views, in bytes: 180 views of 1560 x 1040 pixels take 0.9 GB. Further views are
read from their files at each use."""


PREPARED_BYTES = 2**29
"""Largest memory of the values that a stage's steps compute of its views, in bytes. With two backgrounds a pixel has 52
bytes (two targets of 12, coverage of 4, edge weights of 24): 100 views of 320 x 320 pixels, or 16 of 800 x 800. Values
beyond it are computed at each use, which takes 15 ns a pixel."""


@dataclass
class Memory:
    """Bytes that are left for values computed from views."""

    left: int = PREPARED_BYTES
    """The bytes."""

    def take(self, wanted: int) -> bool:
        """Take so many bytes, if they are left; returns whether they were."""
        taken = wanted <= self.left
        self.left -= wanted if taken else 0
        return taken


@dataclass(frozen=True)
class TrainingView:
    """One training view on a device: camera, image and coverage.

    A ``decoded`` view caches values that steps compute from it, by key: for all steps as far as memory allows, else for
    its own lifetime.
    """

    camera: Camera
    """Camera on the device, float32."""
    view: View
    """View that the pixels are read from."""
    pixels: Num[Tensor, "height width 3"] | None
    """Straight display-sRGB image ``in_memory``; None if it is read from its file at each use."""
    covered: Num[Tensor, "height width"] | None
    """Coverage ``in_memory``; None if it is read from its file at each use, or is 1 in all pixels."""
    memory: Memory = field(default_factory=Memory, compare=False, repr=False)
    """Memory for computed values, shared by all views of a stage."""
    valid: Bool[Tensor, "height width"] | None = field(default=None, compare=False, repr=False)
    """Pixels that count; None if all do. Excluded pixels show things outside the scene: no loss may depend on them,
    neither on the image, which is black there, nor on the model's rendering there (``where_valid``)."""
    lasting: dict[Hashable, Tensor] = field(default_factory=dict, compare=False, repr=False)
    """Values that are kept for all steps; copies of a view share them, its decoded views among them."""
    passing: dict[Hashable, Tensor] | None = field(default=None, compare=False, repr=False)
    """Values that this decoded view alone keeps; None: the view is not decoded, and keeps nothing."""

    @property
    def image(self) -> Float[Tensor, "height width 3"]:
        """Straight display-sRGB image in [0, 1]; not kept between steps, because steps use values derived from it."""
        return self.once(
            "image",
            lambda: self.view.read("image").to(self.device) if self.pixels is None else values_of(self.pixels),
            lasting=False,
        )

    @property
    def mask(self) -> Float[Tensor, "height width"]:
        """Coverage in [0, 1]; 1 in all pixels of a view without alpha, 0 in pixels that do not count."""
        return self.once("mask", self._read_mask)

    def _read_mask(self) -> Float[Tensor, "height width"]:
        if self.covered is not None:
            return self.where_valid(values_of(self.covered))
        if self.view.has("alpha"):
            return self.where_valid(self.view.read("alpha")[..., 0].to(self.device))
        return self.where_valid(torch.ones(self.camera.height, self.camera.width, device=self.device))

    def where_valid(self, image: Float[Tensor, "height width *channels"]) -> Float[Tensor, "height width *channels"]:
        """The image, zero and without gradient at pixels that do not count; unchanged where all do."""
        if self.valid is None:
            return image
        return torch.where(self.valid if image.ndim == 2 else self.valid[..., None], image, 0.0)

    def counting(self, pixels: Int[Tensor, " pixels"]) -> Int[Tensor, " counting"]:
        """The pixels (row * width + column) among these that count."""
        return pixels if self.valid is None else pixels[self.valid.flatten()[pixels]]

    @property
    def device(self) -> torch.device:
        """The device that the view is decoded on."""
        return self.camera.camera_to_world.device

    def over(self, background: float) -> Float[Tensor, "height width 3"]:
        """The image composited in display sRGB on a grey background, as splatting codes do."""
        mask = self.mask[..., None]
        return self.once(("over", background), lambda: self.image * mask + background * (1 - mask))

    def once(self, key: Hashable, make: Callable[[], Tensor], lasting: bool = True) -> Tensor:
        """A value of the view that ``make`` computes: at each use, or once for its key in a decoded view.

        ``lasting``: whether it may be kept from step to step. A kept value must not be changed in place.
        """
        if self.passing is None:
            return make()
        for place in (self.passing, self.lasting):
            if key in place:
                return place[key]
        made = make()
        keeps = lasting and self.memory.take(made.nbytes)
        (self.lasting if keeps else self.passing)[key] = made
        return made

    def decoded(self) -> "TrainingView":
        """The view for a step that looks at it several times: what it computes is kept."""
        return replace(self, passing={})

    def reread(self) -> View:
        """The view with ``image``, ``alpha`` and ``valid`` from memory instead of files, on the CPU."""
        sources = {"image": lambda: self.image.cpu()}
        if self.view.has("alpha"):
            sources["alpha"] = lambda: self.mask.cpu()[..., None]
        if (valid := self.valid) is not None:
            sources["valid"] = lambda: valid.cpu()[..., None].float()
        return replace(self.view, sources=sources)


def chosen_views(scene: Scene, share: float, seed: int) -> tuple[View, ...]:
    """A random subset of ceil(share * count) training views, at least one, in the order of the scene.

    Raises DataError for a scene without training views.
    """
    if not scene.train:
        raise DataError(
            f"scene '{scene.name}' has no training views",
            "A model is learnt from training views.",
            f"Check the scene:  radiogs-bench datasets check {scene.name}",
        )
    count = max(1, -int(-len(scene.train) * share // 1))
    order = torch.randperm(len(scene.train), generator=torch.Generator().manual_seed(seed))
    return tuple(scene.train[int(index)] for index in order[:count].sort().values)


def load(views: Sequence[View], device: torch.device, most: int = HELD_BYTES) -> tuple[TrainingView, ...]:
    """The views on a device; every view is read once.

    Pixels are kept in the bit depth of their files, up to ``most`` bytes in all; further views are read again at each
    use, but for which of their pixels count. A view without alpha is covered in all pixels. Values that steps compute
    of the views are kept besides, up to ``PREPARED_BYTES``.
    """
    loaded, memory = [], Memory()
    for view in views:
        camera = view.camera.to(device, torch.float32)
        pixels = in_memory(view.read("image"), device)
        covered = in_memory(view.read("alpha")[..., 0], device) if view.has("alpha") else None
        needed = pixels.nbytes + (covered.nbytes if covered is not None else 0)
        valid = (view.read("valid")[..., 0] > 0).to(device) if view.has("valid") else None
        if needed <= most:
            most -= needed
            loaded.append(TrainingView(camera, view, pixels, covered, memory, valid))
        else:
            loaded.append(TrainingView(camera, view, None, None, memory, valid))
    return tuple(loaded)


def view_at(views: tuple[TrainingView, ...], iteration: int, seed: int) -> TrainingView:
    """The decoded view of an iteration. Each epoch has its own permutation, which depends on seed and epoch only."""
    epoch, index = divmod(iteration, len(views))
    generator = torch.Generator().manual_seed(seed * 1_000_003 + epoch)
    return views[int(torch.randperm(len(views), generator=generator)[index])].decoded()


def mean_distance(views: tuple[TrainingView, ...], centre: Float[Tensor, "3"]) -> float:
    """Mean distance of the cameras from the scene's centre, world units."""
    return float(torch.stack([(view.camera.centre.cpu().double() - centre).norm() for view in views]).mean())
