"""The plan of a training: fixed, or decided by probes at a few iterations, which depend only on the budget."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.errors import NumericalFailure
from radiogs_core.learning.views import TrainingView
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.plan import MOST_REFRESH_FACTOR, EffectPlan, Effects, plan_of

from ..rays import RaySettings
from .evidence import Evidence
from .image_share import image_share
from .probe import IN_TRAINING, PROBES, Occasion, level_of, probe
from .probe_scene import SHARP_ROUGHNESS, KeptLight, ProbeRays, ProbeScene, ProbeView, Viewpoints, trace_scene
from .staleness import decide_refresh
from .step_cost import Step

DIRECTIONS = 16
"""Largest number of directions that a probe traces from every surfel; it is at most half of training's. Two probes then
take 1 % of the rays of a training with preset tiny. With fewer samples, halving them costs more, so such a probe errs
on the safe side."""

PROBE_VIEWS = 8
"""Number of training views of a probe: one from each eighth of their list."""

STEPS_A_PROBE = 400
"""Least number of steps for each probe after the second. With preset tiny a probe takes as long as 10 to 13 steps, so
that probes stay below 3 % of the time."""


class Planner:
    """Stores the plan. With ``effects`` "auto", decides it by two or three probes, evenly spread over ``iterations``.

    ``samples``: directions of each surfel in training. ``rays``, ``straight``: the variant's rays, and its encoding of
    images for display (``kernels.image.display.displayed``).

    Surfels that lose their rays by a probe keep the light of their last tracing (``EffectPlan.kept``). The seed of each
    probe follows from the training's seed and the iteration: probes are independent, and a resumed training makes the
    same decisions.
    """

    def __init__(
        self, effects: Effects, seed: int, iterations: int, samples: int, rays: RaySettings, straight: bool
    ) -> None:
        self.auto = effects == "auto"
        self.rays, self.straight = rays, straight
        self.seed, self.samples = seed, max(2, min(DIRECTIONS, samples // 2))
        self.plan = plan_of(effects)
        self.evidence: tuple[Evidence, ...] = ()
        self.share: Float[Tensor, " surfels"] | None = None
        probes = min(PROBES, max(2, iterations // STEPS_A_PROBE)) if self.auto else 0
        self.at = frozenset(iterations * index // probes for index in range(probes))

    def due(self, iteration: int) -> bool:
        """Whether a probe is due before this iteration."""
        return iteration in self.at

    def observe(
        self,
        surfels: Surfels,
        environment: Float[Tensor, "rows columns 3"],
        views: Sequence[TrainingView],
        step: Step,
        iteration: int,
        stale: Float[Tensor, " checked"] | None = None,
        kept: KeptLight | None = None,
    ) -> bool:
        """Probe, and adopt the resulting plan; returns whether it traces other rays than the plan before.

        ``stale``: error of the cached incident light before its last refresh, if it is known. ``kept``: the light of
        the surfels that had no rays until now. If the probe finds a value that is not finite, all effects are on.
        """
        before = self.plan
        occasion = Occasion(1_000_003 * (self.seed + 1) + iteration, iteration, before)
        try:
            findings = probe(self.scene(surfels, environment, views, occasion.seed, kept), step, occasion)
            if stale is not None:
                level = level_of(len(IN_TRAINING))
                factor, record = decide_refresh(stale, findings.tolerance, step, occasion, level)
                findings = findings.extended(record, refresh=min(factor, MOST_REFRESH_FACTOR))
        except NumericalFailure as failure:
            self.plan = EffectPlan()
            why = f"the probe failed: {failure.what}"
            self.evidence += (Evidence("plan", "on", why, iteration, occasion.seed, 0.0, None),)
            return not same_rays(before, self.plan)
        self.plan = replace(findings.plan, kept=not findings.plan.traces_all)
        self.evidence += findings.evidence
        return not same_rays(before, self.plan)

    def scene(
        self,
        surfels: Surfels,
        environment: Float[Tensor, "rows columns 3"],
        views: Sequence[TrainingView],
        seed: int,
        kept: KeptLight | None = None,
    ) -> ProbeScene:
        """The scene of a probe with this seed; materials are still being learnt.

        Surfels with ``kept`` light are not traced by the probe: their kept light is compared with light that training's
        rays trace now. The model has been fitted to the kept light, which includes occluders close to a surfel.
        """
        generator = torch.Generator(surfels.centre.device).manual_seed(seed)
        if self.share is None:
            # Computed once: surfels hardly move any more.
            self.share = image_share([view.camera for view in views], surfels)
        viewpoints = Viewpoints(drawn_views(views, seed), self.share, self.straight)
        others = None if kept is None else torch.nonzero(~kept.mask)[:, 0]
        rays = ProbeRays(self.samples, generator, self.rays)
        scene = trace_scene(surfels, environment, viewpoints, rays, among=others)
        # Directions below the horizon are occluded by the surface itself, also where rays start beyond it.
        clear = scene.incident.visibility * scene.untraced.visibility
        incident, untraced = replace(scene.incident, visibility=clear), scene.untraced
        if kept is not None:
            index = torch.nonzero(kept.mask)[:, 0]
            incident, untraced = incident.replaced(index, kept.anew), untraced.replaced(index, kept.light)
        return replace(scene, incident=incident, untraced=untraced, sharpest=SHARP_ROUGHNESS)

    def state(self) -> dict[str, Any]:
        """Tensors and plain values from which ``restore`` continues bit for bit."""
        return {
            "plan": self.plan.state(),
            "evidence": [each.plain() for each in self.evidence],
            "share": self.share,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        self.plan = EffectPlan(**state["plan"])
        self.evidence = tuple(Evidence.of(each) for each in state["evidence"])
        self.share = state["share"]


def drawn_views(views: Sequence[TrainingView], seed: int) -> tuple[ProbeView, ...]:
    """PROBE_VIEWS of the views, one drawn from each of that many equal parts of their list."""
    generator, count = torch.Generator().manual_seed(seed), min(PROBE_VIEWS, len(views))
    drawn = []
    for index in range(count):
        low, high = (len(views) * end // count for end in (index, index + 1))
        view = views[int(torch.randint(low, high, (), generator=generator))]
        drawn.append(ProbeView(view.camera, view.over(0.0)))
    return tuple(drawn)


def same_rays(first: EffectPlan, second: EffectPlan) -> bool:
    """Whether both plans trace the same rays, so that the incident light of one is valid for the other."""
    one, other = first.traced, second.traced
    masks = one is other if one is None or other is None else torch.equal(one, other)
    fields = ("visibility", "indirect", "samples")
    return masks and all(getattr(first, name) == getattr(second, name) for name in fields)
