"""A row that is rehearsed, and the few steps that are taken of it."""

from dataclasses import dataclass
from typing import Any

from radiogs_core.capabilities import Rehearsing, Relighting, ShortRun, StepKind
from radiogs_core.contract import Method
from radiogs_core.errors import UsageError

from ...method_calls import calling

STEPS = 4
"""Steps of each stage of a method that cannot shorten its runs."""


@dataclass(frozen=True)
class Row:
    """A row to be rehearsed: its method, as it was found, and its variant and budget in the whole run."""

    key: str
    method: Method
    found_as: str
    variant: Any
    budget: Any

    def sizes(self) -> tuple[int, int] | None:
        """The size of its models at the start, and at most; None for a method that does not say."""
        return self.method.sizes(self.budget) if isinstance(self.method, Rehearsing) else None

    def short(self, size: int | None) -> ShortRun:
        """The few steps that are taken of it."""
        if isinstance(self.method, Rehearsing) and size is not None:
            return self.method.short_run(self.variant, self.budget, size)
        with calling(self.method.name, "stages()"):
            specs = self.method.stages(self.variant, self.budget)
        for spec in specs:
            if spec.keeps_files:
                raise UsageError(
                    f"{self.method.name} cannot be rehearsed",
                    f"Its stage '{spec.name}' is a program of its own, which takes all its steps.",
                    "Leave its rows out with --method.",
                )
        kinds = {spec.name: (StepKind("step", frozenset(range(min(STEPS, spec.steps))), spec.steps),) for spec in specs}
        return ShortRun(self.variant, self.budget, kinds, (Relighting("relighting", self.variant, 0),))
