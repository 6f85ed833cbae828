"""``SurfelMethod``: a ``contract.Method`` with the shared stage of geometry and one stage of its own."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from ..contract import Run, Stage, StageSpec, Trained, values_but
from .fit_geometry import fit_geometry
from .settings import SurfelBudget, SurfelVariant

V = TypeVar("V", bound=SurfelVariant)
B = TypeVar("B", bound=SurfelBudget)


@dataclass(frozen=True)
class SurfelMethod(Generic[V, B]):
    """A method in two stages; see ``radiogs_core.contract.Method`` and docs/baselines.md."""

    name: str
    """Name in suites and on the command line."""
    title: str
    """Name in tables."""
    package: str
    """Package whose modules ``training`` and ``showing``, and what they import, decide the method's results."""
    variant: type[V]
    """The class of variants."""
    presets: Mapping[str, B]
    """Budgets by name."""
    begin: Callable[[Run[V, B], Mapping[str, Any]], Stage]
    """Makes the stage of inverse rendering from a run and the product of the stage of geometry."""
    trained: Callable[[Mapping[str, Any], Run[V, B]], Trained]
    """Makes the trained model from the product of inverse rendering."""

    @property
    def sources(self) -> tuple[str, ...]:
        """The module that renders trained models; see ``contract.Method``."""
        return (f"{self.package}.showing",)

    def stages(self, variant: V, budget: B) -> Sequence[StageSpec[V, B]]:
        """The shared stage of geometry, and inverse rendering."""
        return (
            fit_geometry(variant.geometry, budget.geometry, variant.view_share),
            StageSpec(
                name="invert",
                title="stage 2, inverse rendering",
                steps=budget.inverse_iterations,
                owner=self.name,
                reads={"variant": variant.of_training(), "budget": values_but(budget, "name", *budget.shown_only)},
                sources=(f"{self.package}.training",),
                begin=self.begin,
                compiles=True,
            ),
        )

    def restore(self, run: Run[V, B], tensors: Mapping[str, Any]) -> Trained:
        """The model from the product of inverse rendering."""
        return self.trained(tensors, run)
