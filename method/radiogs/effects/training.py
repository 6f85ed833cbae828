"""Probes of stage 2: whether they pay, and whether rays are traced (``invert.Planning``)."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import torch

from radiogs_core.contract import Run
from radiogs_core.errors import NumericalFailure
from radiogs_core.instruments import part
from radiogs_core.learning.views import TrainingView
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.plan import EffectPlan
from radiogs_core.transport.tracer import incident_along

from ..incident_cache import IncidentCache
from ..invert import InverseRendering
from ..kept_light import CELLS
from ..model import Model
from ..rays import RaySettings
from ..settings import Budget, Variant
from .decision import TOLERANCE_DB, Evidence
from .plans import Step, why_not_probed
from .probe import PROBES, Occasion, probe
from .probe_scene import PROBE_VIEWS, ProbeRays, ProbeScene, ProbeView, Viewpoints, trace_scene

DIRECTIONS = 16
"""Largest number of directions that a probe traces from every surfel; it is at most half of training's."""

BEFORE = EffectPlan(visibility=False, indirect=False, kept=True)
"""The plan until the first probe, before the first step: without rays, so that none is traced in vain."""


class Planner:
    """The plan of a training that is decided by PROBES probes, evenly spread over its steps, if they pay.

    ``made``: what ``start.make_start`` returned. Without rays, surfels keep the light of their last tracing
    (``EffectPlan.kept``). The seed of each probe follows from the training's seed and the iteration: probes are
    independent, and a resumed training makes the same decisions.
    """

    def __init__(self, run: Run[Variant, Budget], made: Mapping[str, Any]) -> None:
        variant, budget = run.variant, run.budget
        self.initialised, self.seed = made["initialised"], run.seed
        self.rays, self.straight = RaySettings.of(variant), variant.straight
        self.samples = max(2, min(DIRECTIONS, budget.incident_samples // 2))
        view = run.scene.train[0].camera
        self.step = Step.of(variant, budget, len(made["surfels"]["centre"]), view.width * view.height)
        self.plan, self.evidence = BEFORE, tuple[Evidence, ...]()
        self.at = frozenset(budget.inverse_iterations * index // PROBES for index in range(PROBES))
        if (why := why_not_probed(variant, budget, self.step, PROBES)) is not None:
            self.plan, self.at, self.initialised = EffectPlan(), frozenset(), {}
            self.evidence = (Evidence("plan", "on", why, 0, run.seed, TOLERANCE_DB, None),)

    def begin_step(self, stage: InverseRendering) -> None:
        """Probe, if that is due before the stage's next step; the stage adopts a plan with other rays."""
        if stage.iteration not in self.at:
            return
        model, first = stage.model, not stage.iteration
        if first:
            # It sees the materials and light of stage 1: the start values of stage 2 are uninformative.
            model = Model(Surfels.of(self.initialised["surfels"]), self.initialised["log_environment"])
            self.initialised = {}  # which would keep the outcome of stage 1 in memory
        with part("probe"):
            before = self.observe(model, stage.views, stage.iteration, stage.cache)
        if first or before.traces != self.plan.traces:
            stage.cache.adopt(self.plan, stage.model, stage.iteration)

    def observe(self, model: Model, views: Sequence[TrainingView], iteration: int, cache: IncidentCache) -> EffectPlan:
        """Probe ``model``, and hold the resulting plan with its evidence; returns the plan before.

        If the probe finds a value that is not finite, all effects are on.
        """
        before = self.plan
        occasion = Occasion(1_000_003 * (self.seed + 1) + iteration, iteration, before if iteration else EffectPlan())
        try:
            findings = probe(self.scene(model, views, occasion.seed, cache), self.step, occasion, ("visibility",))
        except NumericalFailure as failure:
            self.plan = EffectPlan()
            why = f"the probe failed: {failure.what}"
            self.evidence += (Evidence("plan", "on", why, iteration, occasion.seed, TOLERANCE_DB, None),)
        else:
            self.plan = replace(findings.plan, kept=not findings.plan.traces)
            self.evidence += findings.evidence
        return before

    def scene(self, model: Model, views: Sequence[TrainingView], seed: int, cache: IncidentCache) -> ProbeScene:
        """The scene of a probe with this seed.

        If light is kept, it is compared with light that training's rays trace now, along the same directions. The
        model has been fitted to the kept light, which includes occluders close to a surfel.
        """
        surfels = model.surfels
        generator = torch.Generator(surfels.centre.device).manual_seed(seed)
        viewpoints = Viewpoints(drawn_views(views, seed), self.straight)
        if cache.kept is None:
            rays = ProbeRays(self.samples, generator, self.rays)
            scene = trace_scene(surfels, model.environment, viewpoints, rays)
            # Directions below the horizon are occluded by the surface itself, also where rays start beyond it.
            clear = scene.incident.visibility * scene.untraced.visibility
            return replace(scene, incident=replace(scene.incident, visibility=clear))
        some = torch.randperm(CELLS**2, generator=generator, device=generator.device)[: self.samples]
        kept = cache.kept.through(some)
        cache.tracer.follow(surfels)
        now = incident_along(cache.tracer, kept.direction, kept.weight)
        return ProbeScene(
            **vars(viewpoints), surfels=Surfels.of(surfels.plain()), environment=model.environment.detach(),
            incident=now, untraced=kept,
        )  # fmt: skip

    @property
    def records(self) -> tuple[Mapping[str, Any], ...]:
        """The evidence as plain values, oldest first."""
        return tuple(each.plain() for each in self.evidence)

    def state(self) -> dict[str, Any]:
        """Tensors and plain values from which ``restore`` continues bit for bit."""
        return {"plan": self.plan.state(), "evidence": list(self.records)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        self.plan = EffectPlan(**state["plan"])
        self.evidence = tuple(Evidence.of(each) for each in state["evidence"])


def drawn_views(views: Sequence[TrainingView], seed: int) -> tuple[ProbeView, ...]:
    """PROBE_VIEWS of the views, one drawn from each of that many equal parts of their list."""
    count = min(PROBE_VIEWS, len(views))
    place = torch.arange(count) + torch.rand(count, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    drawn = [views[int(each)] for each in (place * (len(views) / count)).tolist()]
    return tuple(ProbeView(view.camera, view.over(0.0)) for view in drawn)
