"""Settings of all methods on surfels: the budget of stage 1, and the common fields of budgets and variants.

A method's own ``Budget`` and ``Variant`` are subclasses. They share the settings of stage 1, so that rows of different
methods start from the same surfels.

Schedules are shares of a stage (``GeometrySchedule``), so they follow its length by themselves. Rates do not: in fewer
steps of the same size a parameter does not arrive. So they grow in a stage that is shorter than the paper's
(``LengthRule``).
"""

import warnings
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar, Generic, TypeVar

from ..learning.geometry import GeometryLearning
from ..plain_values import NotNegative, require
from .start_values import StartValues


@dataclass(frozen=True)
class LengthRule:
    """A factor for learning rates: (``whole`` / steps) to the power ``power``, at most ``most`` and at least 1."""

    whole: int
    """Steps of the stage in the paper."""
    power: float
    """0: rates do not depend on the length. 1: their sum over the stage does not."""
    most: float = 12.0
    """Largest factor: longer steps destabilise the learnt values."""

    def factor(self, steps: int) -> float:
        """The factor for a stage of so many steps.

        >>> [LengthRule(40_000, 0.83).factor(steps) for steps in (2_000, 40_000, 80_000)]
        [12.0, 1.0, 1.0]
        """
        return min(self.most, max(1.0, self.whole / steps) ** self.power)


POSITIONS = LengthRule(whole=40_000, power=0.83)
"""Positions in stage 1; rotations grow by the root of the factor (``learning.geometry.turning``). Chosen on ``corner``,
``red_white`` and ``bowl`` at 2,000 steps."""


@dataclass(frozen=True, kw_only=True)
class GeometryBudget:
    """The amount of work of stage 1."""

    steps: int
    """Number of optimisation steps."""
    initial_surfels: int
    """Number of surfels at the start."""
    maximum_surfels: int
    """Largest number of surfels that density control may reach."""
    densify_interval: int
    """Steps between two rounds of density control."""
    rate: float
    """Factor of the learning rate of positions; its square root is the factor of rotations. Presets follow the length
    rule (``POSITIONS``)."""

    @classmethod
    def by_rule(cls, steps: int, initial_surfels: int, maximum_surfels: int, densify_interval: int) -> "GeometryBudget":
        """A budget whose factor of rates follows from its steps by the length rule."""
        return cls(
            steps=steps, initial_surfels=initial_surfels, maximum_surfels=maximum_surfels,
            densify_interval=densify_interval, rate=POSITIONS.factor(steps),
        )  # fmt: skip

    @classmethod
    def of(cls, budget: Any) -> "GeometryBudget":
        """``budget`` as a GeometryBudget; one with flat fields is converted, with a FutureWarning."""
        if isinstance(budget, cls):
            return budget
        warnings.warn(
            f"{type(budget).__name__}: give fit_geometry a GeometryBudget in place of a budget with flat fields",
            FutureWarning,
            stacklevel=3,
        )
        return cls(**{new.partition(".")[2]: getattr(budget, old) for old, new in RENAMED.items()})


GEOMETRY_PRESETS: Mapping[str, GeometryBudget] = {
    "smoke": GeometryBudget.by_rule(steps=60, initial_surfels=400, maximum_surfels=600, densify_interval=20),
    "tiny": GeometryBudget.by_rule(steps=2000, initial_surfels=6000, maximum_surfels=6000, densify_interval=100),
    "small": GeometryBudget.by_rule(steps=5000, initial_surfels=20_000, maximum_surfels=50_000, densify_interval=200),
    "paper": GeometryBudget.by_rule(
        steps=40_000, initial_surfels=100_000, maximum_surfels=2_000_000, densify_interval=500
    ),
}
"""Budgets of stage 1 by preset. In the paper, density control runs from 1.25 % to 37.5 % of the 40,000 steps."""

RENAMED: Mapping[str, str] = {
    "initialise_iterations": "geometry.steps",
    "initial_surfels": "geometry.initial_surfels",
    "maximum_surfels": "geometry.maximum_surfels",
    "densify_interval": "geometry.densify_interval",
    "geometry_rate": "geometry.rate",
}
"""Present names of budget fields by their former names; suites may use a former name, with a warning."""


@dataclass(frozen=True, kw_only=True)
class SurfelBudget:
    """The amount of work of a run of a method on surfels."""

    renamed: ClassVar[Mapping[str, str]] = RENAMED
    """Present names of fields by their former names."""
    shown_only: ClassVar[tuple[str, ...]] = ()
    """Fields that training does not read: runs that differ only in these share the trained model."""

    name: str
    """Name of the preset."""
    geometry: GeometryBudget
    """Budget of stage 1."""
    inverse_iterations: int
    """Number of steps of stage 2."""
    light_height: int
    """Rows of the learnt environment map; it has twice as many columns."""


BudgetT = TypeVar("BudgetT", bound=SurfelBudget)


def by_name(*budgets: BudgetT) -> dict[str, BudgetT]:
    """Budgets by the names of their presets, for ``Method.presets``."""
    return {budget.name: budget for budget in budgets}


def presets(budget: type[BudgetT], **numbers: tuple[float, float, float, float]) -> dict[str, BudgetT]:
    """Budgets by the names of the presets, smoke, tiny, small and paper; each field has its values in this order."""
    found = {}
    for index, (name, geometry) in enumerate(GEOMETRY_PRESETS.items()):
        given: Any = {field: values[index] for field, values in numbers.items()}
        found[name] = budget(name=name, geometry=geometry, **given)
    return found


@dataclass(frozen=True)
class SurfelVariant:
    """The settings that an ablation of a method on surfels may change; the defaults are the full method.

    Raises UsageError for a value out of range.
    """

    shown_only: ClassVar[tuple[str, ...]] = ()
    """Fields that training does not read: cells that differ only in these share the trained model."""

    view_share: float = 1.0
    """Share of the training views that both stages use, in (0, 1]."""
    geometry: GeometryLearning = field(default_factory=GeometryLearning)
    """Weights, rates and schedule of stage 1."""

    def __post_init__(self) -> None:
        require(self, "above 0 and at most 1", "view_share")

    @property
    def straight(self) -> bool:
        """Whether images are encoded for display from straight radiance (``kernels.image.display.displayed``)."""
        return self.geometry.encoding == "straight"

    def of_training(self) -> dict[str, Any]:
        """The fields that decide the trained model, as plain values."""
        return {name: value for name, value in asdict(self).items() if name not in self.shown_only}


WeightsT = TypeVar("WeightsT", bound=NotNegative)
RatesT = TypeVar("RatesT", bound=NotNegative)
StartT = TypeVar("StartT", bound=StartValues)


@dataclass(frozen=True)
class MaterialLearning(Generic[WeightsT, RatesT, StartT]):
    """How a method on surfels learns materials and light in stage 2."""

    weights: WeightsT
    """Weights of the losses."""
    rates: RatesT
    """Adam's learning rates."""
    start: StartT
    """Initial materials and light."""
