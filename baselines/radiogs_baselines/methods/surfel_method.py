"""What the methods on shared surfels are to the harness: the shared stage of geometry, then one of their own."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from radiogs_core.contract import Run, Stage, StageSpec, Trained, values_but
from radiogs_core.learning.fit_geometry import fit_geometry


@dataclass(frozen=True)
class SurfelMethod:
    """A method in two stages; see ``radiogs_core.contract.Method`` and docs/baselines.md.

    package: the name of its package; its modules ``training`` and ``showing`` and what they import decide its results.
    begin: its inverse rendering, from a run and the surfels of the shared stage. trained: its model, from the product
    of that. shown_only: fields of the budget that training does not read.
    """

    name: str
    title: str
    package: str
    variant: type[Any]
    presets: Mapping[str, Any]
    begin: Callable[[Run, Mapping[str, Any]], Stage]
    trained: Callable[[Mapping[str, Any], Run], Trained]
    shown_only: tuple[str, ...] = ()

    @property
    def sources(self) -> tuple[str, ...]:
        """The module that shows models; see ``contract.Method``."""
        return (f"{self.package}.showing",)

    def stages(self, variant: Any, budget: Any) -> Sequence[StageSpec]:
        """The shared stage of geometry, and inverse rendering."""
        return (
            fit_geometry(variant.geometry, budget, variant.view_share),
            StageSpec(
                name="invert",
                title="stage 2, inverse rendering",
                steps=budget.inverse_iterations,
                owner=self.name,
                reads={"variant": variant.of_training(), "budget": values_but(budget, "name", *self.shown_only)},
                sources=(f"{self.package}.training",),
                begin=self.begin,
                compiles=True,
            ),
        )

    def restore(self, run: Run, tensors: Mapping[str, Any]) -> Trained:
        """The model from the product of inverse rendering."""
        return self.trained(tensors, run)
