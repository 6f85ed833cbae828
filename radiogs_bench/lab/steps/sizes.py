"""The sizes that steps are measured at, by name."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from radiogs_core.capabilities import Rehearsing
from radiogs_core.contract import Method
from radiogs_core.errors import unknown
from radiogs_core.plain_values import leaf_names, value_at


@dataclass(frozen=True)
class Size:
    """A model and images of one size."""

    name: str
    preset: str
    """Preset whose samples, surfels of a step and light are used."""
    side: int
    """Side of the square images, pixels."""
    surfels: int | None
    """Surfels of the model; None: as many as the preset allows."""
    views: int
    """Training views."""
    passes: int
    """Default number of passes."""
    values: Mapping[str, int] = field(default_factory=dict)
    """Values that replace the preset's numbers, by dotted name; numbers that a method's budget lacks are skipped."""


SIZES = {
    size.name: size
    for size in (
        Size("smoke", "smoke", 32, 400, 4, 1),
        Size("floor", "tiny", 16, 32, 48, 6, {"consistency_surfels": 4}),
        Size("tiny", "tiny", 96, None, 48, 4),
        Size("long", "tiny", 96, 6_000, 48, 2, {"consistency_surfels": 1_024, "incident_samples": 64}),
        Size("20k", "small", 100, 20_000, 48, 2),
        Size("small", "small", 200, None, 48, 2),
        Size("paper", "paper", 800, 100_000, 100, 1),
    )
}

WARM_UP = SIZES["smoke"]
"""Size of the pass before anything is timed."""

OWN_SIZES = tuple(name for name, size in SIZES.items() if size.surfels is None)
"""Sizes with as many surfels as a preset's largest model: any method can be measured at them."""


def size_of(name: str) -> Size:
    """A size by its name. Raises UsageError for an unknown name."""
    if name not in SIZES:
        raise unknown("size", name, SIZES)
    return SIZES[name]


SURFEL_FIELDS = ("initial_surfels", "maximum_surfels")
"""Names of a budget's numbers of a model's surfels, wherever they are nested."""


def surfel_fields(budget: Any) -> list[str]:
    """The dotted names of a budget's numbers of a model's surfels; none for a method without surfels."""
    return [name for name in leaf_names(budget) if name.rpartition(".")[2] in SURFEL_FIELDS]


def largest_model(method: Method, budget: Any) -> int | None:
    """The largest number of surfels of a model; None if the method does not report it."""
    if isinstance(method, Rehearsing):
        return method.sizes(budget)[1]
    return max((value_at(budget, name) for name in surfel_fields(budget)), default=None)


def can_be_sized(method: Method, budget: Any) -> bool:
    """Whether the number of a model's surfels can be set."""
    return isinstance(method, Rehearsing) or bool(surfel_fields(budget))
