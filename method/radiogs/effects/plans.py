"""Plans that leave an effect out, completely or where it does not matter, and the work that they save.

Work is counted, not timed: decisions must not depend on a machine's load.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from radiogs_core.scene.colour import srgb_encode
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.plan import HIGHEST_DEGREE, EffectPlan
from radiogs_core.transport.tracer import EVERYTHING

from ..settings import Budget, Variant
from .probe_scene import PlanRadiance

RAY_SHARES = (0.25, 1.0, 4.0, 16.0)
"""Partial plans for rays: each leaves out the rays of the surfels that together change the images by at most this
multiple of the tolerated error. ``partial_ray_plans`` overestimates the change, so multiples above one are tried."""

ROUGHNESS_EDGES = (0.7, 0.6, 0.5, 0.3)
"""Partial plans for specular lobes: each has lobes only on surfels with a roughness below this value."""


def plan_without(effect: str) -> EffectPlan:
    """The plan that leaves one effect out completely.

    The same rays give visibility and indirect light, so visibility is left out only together with indirect light.
    """
    if effect == "visibility":
        return EffectPlan().without("indirect").without("visibility")
    return EffectPlan().without(effect)


def partial_plans(effect: str, surfels: Surfels) -> list[EffectPlan]:
    """Plans that leave part of an effect out, in ascending order; empty for an effect that has no parts."""
    if effect == "specular":
        return [EffectPlan(specular_at=surfels.roughness < edge) for edge in ROUGHNESS_EDGES]
    if effect == "view-dependence":
        return [EffectPlan(sh_degree=degree) for degree in reversed(range(1, HIGHEST_DEGREE))]
    return []


def partial_ray_plans(radiance: PlanRadiance, tolerated: float) -> list[EffectPlan]:
    """For each of RAY_SHARES, the plan without the rays of the surfels that matter least to the images.

    ``tolerated``: mean squared error, display sRGB. A surfel changes the squared error of the images by at most its
    share of them times the square of its largest change towards any view (``image_share``; Jensen). Many surfels of a
    trained model lie unseen below its surface, where most of the sky is occluded.
    """
    without = radiance.shaded(plan_without("visibility")).detach()
    change = srgb_encode(without) - srgb_encode(radiance.shaded(EffectPlan()).detach())
    error = radiance.scene.share * change.square().mean(-1).amax(1)
    ordered, index = error.sort()
    together = ordered.cumsum(0)
    plans = []
    for share in RAY_SHARES:
        traced = torch.ones_like(error, dtype=torch.bool)
        traced[index[together <= share * tolerated]] = False
        plans.append(EffectPlan(traced=traced))
    return plans


def combined(plans: Iterable[EffectPlan]) -> EffectPlan:
    """The plan that leaves out what any of the plans leaves out, each of which leaves out another effect."""
    changed = {
        name: value
        for plan in plans
        for name, value in plan.state().items()
        if isinstance(value, Tensor) or value != getattr(EVERYTHING, name)
    }
    plan = replace(EVERYTHING, **changed)
    return plan if plan.traces else replace(plan, traced=None)


MICROSECONDS = {
    "rays": 0.45, "directions": 0.2, "compared": 0.12, "shaded_samples": 0.0115, "lobes": 0.0025,
    "coefficients": 0.003, "surfels": 0.8, "pixels": 0.8,
}  # fmt: skip
"""Microseconds of one CPU core for one unit of each kind of work, forward and backward: traced rays; directions that
are drawn; samples of L_rad; shaded samples of all surfels, and those with a lobe; coefficients of harmonics; and the
surfels and pixels of a step, whose work no plan changes. Only their ratios matter."""

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
        """A step by a run's settings, with so many surfels and pixels."""
        return cls(
            surfels, budget.consistency_surfels, budget.incident_samples, budget.refresh_interval,
            variant.materials.directions.sets, pixels,
        )  # fmt: skip

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
        anew = self.sets * self.surfels / (self.interval * plan.refresh)
        shaded = self.sets * self.surfels * samples
        rays = traced * samples * (chosen + anew)
        # Without indirect light a ray still finds occluders, but reads no harmonics.
        read = rays * HITS if plan.indirect else 0.0
        return {
            "rays": rays,
            "directions": samples * (traced * chosen + anew),
            "compared": samples * chosen,
            "shaded_samples": shaded,
            "lobes": shiny * shaded,
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
    """The reason for which probes of a training do not pay, in words; None if they pay.

    They pay if a scene that needs no rays would be trained in at most 1 - LEAST_SAVED of the work of all effects, and
    if the probes themselves take at most MOST_PROBING of it. ``step``: a step of stage 2 with the surfels of stage 1.
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
