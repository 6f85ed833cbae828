"""Settings that all methods on surfels have: stage 1's half of a budget, and the common fields of budget and variant.

A method's own ``Budget`` and ``Variant`` are subclasses; stage 1 is the same value in all of them, so that rows of
different methods start from the same surfels.
"""

import warnings
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar, TypeVar

from ..errors import UsageError
from ..learning.geometry import GeometryLearning


@dataclass(frozen=True, kw_only=True)
class GeometryBudget:
    """How much work stage 1 may do."""

    steps: int
    """Optimisation steps."""
    initial_surfels: int
    """Surfels to start with."""
    maximum_surfels: int
    """Number of surfels that density control never exceeds."""
    densify_interval: int
    """Steps between two rounds of density control."""
    rate: float
    """Factor of the learning rate of positions, and by its root of that of rotations: short runs take longer steps."""

    @classmethod
    def of(cls, budget: Any) -> "GeometryBudget":
        """The value itself; a budget with flat fields of the former names is converted, with a warning."""
        if isinstance(budget, cls):
            return budget
        warnings.warn(
            f"{type(budget).__name__}: give fit_geometry a GeometryBudget in place of a budget with flat fields",
            FutureWarning,
            stacklevel=3,
        )
        return cls(**{new.partition(".")[2]: getattr(budget, old) for old, new in RENAMED.items()})


GEOMETRY_PRESETS: Mapping[str, GeometryBudget] = {
    "smoke": GeometryBudget(steps=60, initial_surfels=400, maximum_surfels=600, densify_interval=20, rate=12.0),
    "tiny": GeometryBudget(steps=2000, initial_surfels=6000, maximum_surfels=6000, densify_interval=100, rate=12.0),
    "small": GeometryBudget(steps=5000, initial_surfels=20_000, maximum_surfels=50_000, densify_interval=200, rate=5.0),
    "paper": GeometryBudget(
        steps=40_000, initial_surfels=100_000, maximum_surfels=2_000_000, densify_interval=500, rate=1.0
    ),
}
"""Stage 1 by preset. The paper has density control in 5 % to 62.5 % of its steps (25,000 of 40,000)."""

RENAMED: Mapping[str, str] = {
    "initialise_iterations": "geometry.steps",
    "initial_surfels": "geometry.initial_surfels",
    "maximum_surfels": "geometry.maximum_surfels",
    "densify_interval": "geometry.densify_interval",
    "geometry_rate": "geometry.rate",
}
"""Fields of budgets that had another name; suites may use the old one, with a warning."""


@dataclass(frozen=True, kw_only=True)
class SurfelBudget:
    """How much work a run of a method on surfels may do."""

    renamed: ClassVar[Mapping[str, str]] = RENAMED
    """Fields by their former names."""
    shown_only: ClassVar[tuple[str, ...]] = ()
    """Fields that training does not read: runs that differ in these alone share the trained model."""

    name: str
    """Name of the preset."""
    geometry: GeometryBudget
    """Stage 1."""
    inverse_iterations: int
    """Steps of stage 2."""
    light_height: int
    """Rows of the learnt environment map; it has twice as many columns."""


BudgetT = TypeVar("BudgetT", bound=SurfelBudget)


def by_name(*budgets: BudgetT) -> dict[str, BudgetT]:
    """Budgets by the names of their presets, for ``Method.presets``."""
    return {budget.name: budget for budget in budgets}


@dataclass(frozen=True)
class SurfelVariant:
    """The settings that an ablation of a method on surfels may change; the defaults are the full method."""

    shown_only: ClassVar[tuple[str, ...]] = ()
    """Fields that training does not read: cells that differ in these alone share the trained model."""

    view_share: float = 1.0
    """Share of the training views that both stages may see, in (0, 1]."""
    geometry: GeometryLearning = field(default_factory=GeometryLearning)
    """Weights, rates and schedule of stage 1."""

    def __post_init__(self) -> None:
        if not 0 < self.view_share <= 1:
            raise UsageError(f"view_share: {self.view_share} is not above 0 and at most 1")

    def require(self, wanted: str, *names: str) -> None:
        """Raise UsageError unless all these fields are "above zero" or "zero or above"; None passes."""
        for name in names:
            value = getattr(self, name)
            if value is not None and (value < 0 or (value == 0 and wanted == "above zero")):
                raise UsageError(f"{name}: {value} is not {wanted}")

    @property
    def straight(self) -> bool:
        """Whether images are encoded for display by straight radiance (see ``splatting.displayed``)."""
        return self.geometry.encoding == "straight"

    def of_training(self) -> dict[str, Any]:
        """The fields that decide the trained model, as plain values."""
        return {name: value for name, value in asdict(self).items() if name not in self.shown_only}
