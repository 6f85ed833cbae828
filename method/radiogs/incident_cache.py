"""Cache of V and L_ind of all surfels between two tracings (paper, section on inverse rendering)."""

from dataclasses import replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.plan import EffectPlan
from radiogs_core.transport.tracer import EVERYTHING, incident_along

from .kept_light import KeptLight
from .model import Model
from .rays import RaySettings
from .settings import Budget, Variant


class IncidentCache:
    """V and L_ind of all surfels, each along its own directions.

    A step traces the light on the surfels that it draws, and caches it; every ``refresh_interval`` steps the light on
    all surfels is traced again. ``Variant.incident`` and ``plan`` may limit both. Under a plan that keeps light
    (``EffectPlan.kept``), V and L_ind come from ``kept`` along directions that are drawn as often: with directions
    that stayed, the noise of their sums would stay, and materials would be fitted to it.
    """

    def __init__(
        self,
        model: Model,
        rays: RaySettings,
        variant: Variant,
        budget: Budget,
        generator: torch.Generator,
        plan: EffectPlan = EVERYTHING,
    ) -> None:
        self.rays, self.budget, self.generator, self.plan = rays, budget, generator, plan
        self.traced_again = variant.incident != "precomputed"
        """Whether light is traced again after the beginning of stage 2."""
        self.gradient = variant.incident == "traced"
        """Whether traced light has gradient to the surfels that rays hit."""
        self.tracer = rays.tracer(model.surfels)
        self.sampled: tuple[Tensor, int, LightSampler] | None = None
        """The logarithm of a light, how often it had been changed in place, and a sampler of that light."""
        self.kept: KeptLight | None = None
        self.renew(model, 0)

    @property
    def samples(self) -> int:
        """Number of directions of each surfel in a set (N_s)."""
        return max(1, self.budget.incident_samples // self.plan.samples)

    @property
    def interval(self) -> int:
        """Steps from one tracing of all surfels to the next."""
        return self.budget.refresh_interval * self.plan.refresh

    @property
    def sets(self) -> int:
        """Number of independent sets of directions."""
        return self.rays.directions.sets

    def set_of(self, iteration: int) -> int:
        """Number of the set whose directions are drawn anew in a step."""
        return iteration % self.sets

    def rows(self, index: Int[Tensor, " chosen"], number: int) -> Int[Tensor, " chosen"]:
        """Rows of the set ``number`` of the surfels at ``index``, where each set of a surfel is a row."""
        return self.sets * index + number

    def of_set(self, index: Int[Tensor, " chosen"], number: int) -> Incident:
        """The cached light on the surfels at ``index`` along the directions of the set ``number`` alone."""
        rows = self.rows(index, number)
        light = Incident(**{name: self._by_set(value)[rows] for name, value in vars(self.incident).items()})
        return replace(light, weight=self.sets * light.weight)

    def store(self, index: Int[Tensor, " chosen"], number: int, fresh: Incident) -> None:
        """Overwrite the set ``number`` of the surfels at ``index`` with ``fresh``, without gradient."""
        rows = self.rows(index, number)
        for name, value in vars(replace(fresh, weight=fresh.weight / self.sets)).items():
            self._by_set(getattr(self.incident, name))[rows] = value.detach()

    def _by_set(self, value: Tensor) -> Tensor:
        """A view of cached samples, [surfels, all samples, ...], in which each set of a surfel is a row."""
        return value.view(self.sets * len(value), -1, *value.shape[2:])

    def light_on(self, index: Int[Tensor, " chosen"], model: Model, iteration: int) -> Incident:
        """The light on the surfels ``index`` along a set of directions: along new ones and cached, or from the cache if
        light is traced once."""
        if self.traced_again and iteration % self.interval == 0 and iteration != self.traced_at:
            self.renew(model, iteration)
        number = self.set_of(iteration)
        return self.fresh(index, model, number) if self.traced_again else self.of_set(index, number)

    def adopt(self, plan: EffectPlan, model: Model, iteration: int) -> None:
        """Follow another plan from now on; for one that keeps light, all surfels are traced a last time."""
        self.plan, self.kept = plan, None
        if plan.kept:
            self.tracer.follow(model.surfels)
            self.kept = KeptLight.traced(self.tracer)
        self.renew(model, iteration)

    def renew(self, model: Model, iteration: int) -> None:
        """Trace the light on all surfels along new directions, as at the beginning of stage 2."""
        self.incident = self.gathered(model)
        self.traced_at = iteration

    def gathered(self, model: Model) -> Incident:
        """The light on all surfels along new directions, without gradient."""
        self.tracer.follow(model.surfels)
        sets = [self.directions(model) for _ in range(self.sets)]
        direction, weight = (torch.cat(each, 1) for each in zip(*sets, strict=True))
        weight = weight / self.sets
        if self.kept is None:
            return incident_along(self.tracer, direction, weight, self.plan)
        return self.kept.along(direction, weight)

    @torch.no_grad()
    def directions(
        self, model: Model, index: Int[Tensor, " chosen"] | None = None
    ) -> tuple[Float[Tensor, "chosen samples 3"], Float[Tensor, "chosen samples"]]:
        """New directions in a set of the surfels at ``index`` (None: all), and their solid angles in steradian."""
        normal = model.surfels.frame[..., 2]
        light = self._sampler(model.log_environment) if self.rays.reads_light else None
        return self.rays.drawn(normal if index is None else normal[index], self.samples, light, self.generator)

    def _sampler(self, log_environment: Float[Tensor, "height width 3"]) -> LightSampler:
        """A sampler of the light as it is now, kept until the light changes."""
        sampled, version = self.sampled, log_environment._version
        if sampled is None or sampled[0] is not log_environment or sampled[1] != version:
            sampled = log_environment, version, LightSampler(EnvironmentMap(log_environment.exp()))
            self.sampled = sampled
        return sampled[2]

    def fresh(self, index: Int[Tensor, " chosen"], model: Model, number: int) -> Incident:
        """The light on the surfels ``index``, traced or kept, along new directions; it is stored as set ``number``."""
        self.tracer.follow(model.surfels)
        with torch.set_grad_enabled(torch.is_grad_enabled() and self.gradient):
            direction, weight = self.directions(model, index)
            if self.kept is None:
                fresh = self.tracer.incident(index, direction, weight, self.plan)
            else:
                fresh = self.kept.along(direction, weight, index)
        self.store(index, number, fresh)
        return fresh
