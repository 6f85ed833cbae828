"""Plans that leave an effect out, and the work that they save.

Work is counted, not timed: decisions must not depend on a machine's load.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from radiogs_core.transport.plan import EffectPlan
from radiogs_core.transport.tracer import EVERYTHING

from ..settings import Budget, Variant


def plan_without(effect: str) -> EffectPlan:
    """The plan that leaves one effect out completely.

    The same rays give visibility and indirect light, so visibility is left out only together with indirect light.
    """
    if effect == "visibility":
        return EffectPlan().without("indirect").without("visibility")
    return EffectPlan().without(effect)


def combined(plans: Iterable[EffectPlan]) -> EffectPlan:
    """The plan that leaves out what any of the plans leaves out."""
    changed = {
        name: value for plan in plans for name, value in plan.state().items() if value != getattr(EVERYTHING, name)
    }
    return replace(EVERYTHING, **changed)


MICROSECONDS = {
    "rays": 0.45, "directions": 0.2, "compared": 0.12, "shaded_samples": 0.0115, "lobes": 0.0025,
    "coefficients": 0.003, "surfels": 0.8, "pixels": 0.8,
}  # fmt: skip
"""Microseconds of one CPU core for one unit of each kind of work, forward and backward: traced rays; directions that
are drawn; samples of L_rad; shaded samples, and shaded samples with a lobe; coefficients of harmonics; and the surfels
and pixels of a step, whose work no plan changes. Only their ratios matter."""

HITS = 4.0
"""Average number of surfels that a ray blends."""

SEARCH = 7e6
"""Microseconds of the search for the light before stage 2, which no plan changes."""


def cost(work: Mapping[str, float]) -> float:
    """Microseconds for amounts of work, by the kinds of MICROSECONDS."""
    return sum(MICROSECONDS[name] * amount for name, amount in work.items())


@dataclass(frozen=True)
class Step:
    """The size of a step of stage 2."""

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
    pixels: int = 0
    """Pixels of a view."""

    @classmethod
    def of(cls, variant: Variant, budget: Budget, surfels: int, pixels: int) -> "Step":
        """A step by a run's settings, with these numbers of surfels and pixels."""
        return cls(
            surfels, budget.consistency_surfels, budget.incident_samples, budget.refresh_interval,
            variant.materials.directions.sets, pixels,
        )  # fmt: skip

    def work(self, plan: EffectPlan) -> dict[str, float]:
        """Amounts of work of a step under a plan, by the kinds of MICROSECONDS."""
        samples = max(1, self.samples // plan.samples)
        chosen = min(self.chosen, self.surfels)
        anew = self.sets * self.surfels / (self.interval * plan.refresh)
        shaded = self.sets * self.surfels * samples
        rays = plan.traces * samples * (chosen + anew)
        # Without indirect light a ray still finds occluders, but reads no harmonics.
        read = rays * HITS if plan.indirect else 0.0
        return {
            "rays": rays,
            "directions": samples * (plan.traces * chosen + anew),
            "compared": samples * chosen,
            "shaded_samples": shaded,
            "lobes": plan.specular * shaded,
            "coefficients": (self.surfels + 2 * chosen + read) * (plan.sh_degree + 1) ** 2,
            "surfels": self.surfels,
            "pixels": self.pixels,
        }

    def saving(self, plan: EffectPlan) -> float:
        """Share of a step's work that is saved under ``plan``."""
        return 1 - cost(self.work(plan)) / cost(self.work(EVERYTHING))


LEAST_SAVED = 0.25
"""Least share of a training's work that its rays must be for probes to run."""

MOST_PROBING = 0.02
"""Largest share of a training's work that probes may take."""

STEPS_A_PROBE = 45
"""A probe takes about as long as the surfels and pixels of this many steps."""


def why_not_probed(variant: Variant, budget: Budget, step: Step, probes: int) -> str | None:
    """Why probes of a training do not pay off, in words; None if they do.

    They pay off if training without rays takes at most 1 - LEAST_SAVED of the work with all effects, and the probes
    themselves take at most MOST_PROBING of it. ``step``: a step of stage 2 with the surfels of stage 1.
    """
    anyway = cost({"surfels": step.surfels, "pixels": step.pixels})
    each, steps = cost(step.work(EVERYTHING)), budget.inverse_iterations
    whole = budget.geometry.steps * anyway + SEARCH + steps * each
    probing = probes * STEPS_A_PROBE * anyway / whole
    traced_again = variant.incident != "precomputed"
    saved = steps * each * step.saving(plan_without("visibility")) / whole - probing if traced_again else 0.0
    if saved < LEAST_SAVED:
        least = f"from {100 * LEAST_SAVED:.0f} % on a probe pays"
        return f"no probe: without rays the training would take {100 * max(saved, 0):.0f} % less work; {least}"
    if probing > MOST_PROBING:
        return (
            f"no probe: probes would take {100 * probing:.1f} % of the training, more than {100 * MOST_PROBING:.0f} %"
        )
    return None
