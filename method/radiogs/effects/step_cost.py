"""The work of a step under a plan. It is counted, not timed: decisions must not depend on a machine's load."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from radiogs_core.transport.plan import EffectPlan

from ..settings import Budget, Variant

MICROSECONDS = {"rays": 2.0, "shaded_samples": 0.024, "lobes": 0.0025, "coefficients": 0.003, "surfels": 8.0}
"""Microseconds of one CPU core for one unit of each kind of work, forward and backward. ``surfels`` is the work for a
surfel that no plan changes. Only the ratios matter, to decide whether an effect takes more than LEAST_SHARE of a
step."""


@dataclass(frozen=True)
class Step:
    """The size of a step of stage 2, by the budget."""

    surfels: int
    """Number of all surfels."""
    chosen: int
    """Number of surfels in L_rad (N_g)."""
    samples: int
    """Directions of each surfel in a set (N_s)."""
    interval: int
    """Steps from one refresh of all incident light to the next."""
    sets: int = 1
    """Number of cached sets of directions."""

    def work(self, plan: EffectPlan) -> dict[str, float]:
        """Amounts of work of a step under a plan, by the kinds of MICROSECONDS."""
        samples = max(1, self.samples // plan.samples)
        traced = 0.0
        if plan.traces:
            traced = 1.0 if plan.traced is None else float(plan.traced.double().mean())
        shiny = 0.0
        if plan.specular:
            shiny = 1.0 if plan.specular_at is None else float(plan.specular_at.double().mean())
        chosen = min(self.chosen, self.surfels)
        shaded = (self.sets * self.surfels + 2 * chosen) * samples
        rays = traced * samples * (chosen + self.sets * self.surfels / (self.interval * plan.refresh))
        # Without indirect light a ray still finds occluders, but reads no harmonics.
        read = rays * HITS if plan.indirect else 0.0
        return {
            "rays": rays,
            "shaded_samples": shaded,
            "lobes": shiny * shaded,
            "coefficients": (self.surfels + 2 * chosen + read) * (plan.sh_degree + 1) ** 2,
            "surfels": self.surfels,
        }

    def saving(self, plan: EffectPlan, reference: EffectPlan) -> float:
        """Share of a step's work under ``reference`` that is saved under ``plan``."""
        return 1 - cost(self.work(plan)) / cost(self.work(reference))

    def saved(self, plan: EffectPlan, reference: EffectPlan) -> dict[str, Any]:
        """The fields ``share``, ``rays`` and ``seconds`` of ``evidence.Measured``: the work that ``plan`` saves."""
        less, whole = self.work(plan), self.work(reference)
        return {
            "share": self.saving(plan, reference),
            "rays": round(whole["rays"] - less["rays"]),
            "seconds": 1e-6 * (cost(whole) - cost(less)),
        }


def step_of(variant: Variant, budget: Budget, surfels: int) -> Step:
    """A step of stage 2 by a run's settings, with so many surfels."""
    sets = variant.materials.directions.sets
    return Step(surfels, budget.consistency_surfels, budget.incident_samples, budget.refresh_interval, sets)


HITS = 4.0
"""Average number of surfels that a ray blends."""


def cost(work: Mapping[str, float]) -> float:
    """Microseconds for amounts of work, by the kinds of MICROSECONDS."""
    return sum(MICROSECONDS[name] * amount for name, amount in work.items())
