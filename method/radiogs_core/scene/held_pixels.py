"""Pixels in as little memory as keeps every bit of them: as the whole numbers that image files store."""

from dataclasses import dataclass
from functools import cache

import torch
from jaxtyping import Float, Integer
from torch import Tensor

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


def size(pixels: Levels | Whole) -> int:
    """Bytes that they take."""
    kept = pixels.levels if isinstance(pixels, Levels) else pixels.pixels
    return kept.numel() * kept.element_size()


@cache
def _values(most: int) -> Float[Tensor, " levels"]:
    """What each level stands for, as the readers of image files compute it; divided on the CPU alone, because a GPU
    multiplies by the reciprocal."""
    return torch.arange(most + 1, dtype=torch.float32) / most
