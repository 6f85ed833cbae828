"""The sizes that steps are measured at, by name."""

from dataclasses import dataclass
from typing import Any

from radiogs_core.errors import unknown


@dataclass(frozen=True)
class Size:
    """A model and images of one size.

    preset: whose samples, surfels a step and light are taken. side: pixels of a square image. surfels: None for as many
    as the preset's largest model may have. views: training views. passes: how often all is done by default.
    """

    name: str
    preset: str
    side: int
    surfels: int | None
    views: int
    passes: int


SIZES = {
    size.name: size
    for size in (
        Size("smoke", "smoke", 32, 400, 4, 1),
        Size("tiny", "tiny", 96, None, 48, 4),
        Size("20k", "small", 100, 20_000, 48, 2),
        Size("small", "small", 200, None, 48, 2),
        Size("paper", "paper", 800, 100_000, 100, 1),
    )
}

WARM_UP = SIZES["smoke"]
"""Done once before anything is timed: kernels are compiled, and libraries loaded."""

DEFAULT = ("tiny", "20k")
"""Those that take seconds."""


def size_of(name: str) -> Size:
    """A size by its name. Raises UsageError for one that is not there."""
    if name not in SIZES:
        raise unknown("size", name, SIZES)
    return SIZES[name]


def surfels_at(size: Size, budget: Any) -> int | None:
    """How many surfels a model has at this size; None for a method whose budget does not say."""
    return size.surfels if size.surfels is not None else getattr(budget, "maximum_surfels", None)
