"""The plan of a training: fixed, or decided by probes at a few iterations that depend on the budget alone."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.errors import NumericalFailure
from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.plan import MOST_REFRESH_FACTOR, EffectPlan, Effects, plan_of

from ..rays import RaySettings
from .evidence import Evidence
from .image_share import image_share
from .probe import IN_TRAINING, PROBES, Findings, Occasion, level_of, probe
from .probe_scene import SHARP_ROUGHNESS, KeptLight, ProbeRays, ProbeScene, ProbeView, Viewpoints, trace_scene
from .staleness import Staleness, decide_refresh
from .step_cost import Step

DIRECTIONS = 16
"""Directions that a probe traces from every surfel, or half of those of training if that is less: two probes are then
1 % of the rays of a training with preset tiny. Halving fewer samples costs more, so such a probe errs to the safe
side."""

PROBE_VIEWS = 8
"""Training views that a probe looks from, one of each eighth of their list."""

STEPS_A_PROBE = 400
"""Least number of steps for each probe beyond the second: with preset tiny a probe takes as long as 10 to 13 steps, and
probes are to stay under 3 %."""


@runtime_checkable
class PosedImage(Protocol):
    """A training view as a probe needs it: a camera and its image."""

    @property
    def camera(self) -> Camera:
        """Where it was taken from."""

    def over(self, background: float) -> Float[Tensor, "height width 3"]:
        """Its image in display sRGB on a grey background."""


class Planner:
    """Holds the plan; with ``effects`` "auto", probes two or three times, evenly over ``iterations``, and decides anew.

    ``rays`` and ``straight``: as the variant traces rays and encodes images for display (``splatting.displayed``).

    Surfels whose rays a probe takes away keep the light of a last tracing (``EffectPlan.kept``). Every probe has a seed
    of its own, made from the training's seed and the iteration: probes are independent, and a training that is resumed
    decides as it would have.
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
        self.at = frozenset(iterations * place // probes for place in range(probes))

    def due(self, iteration: int) -> bool:
        """Whether to probe before this iteration."""
        return iteration in self.at

    def observe(
        self,
        surfels: Surfels,
        environment: Float[Tensor, "rows columns 3"],
        views: Sequence[PosedImage],
        step: Step,
        iteration: int,
        stale: Staleness | None = None,
        kept: KeptLight | None = None,
    ) -> bool:
        """Probe, and adopt the plan that follows; returns whether it traces other rays than the plan before.

        ``stale``: how far the cached incident light was off before its last refresh, where that is known. ``kept``:
        the light of the surfels that went without rays until now. If the probe meets a value that is not finite,
        everything is on.
        """
        before = self.plan
        occasion = Occasion(1_000_003 * (self.seed + 1) + iteration, iteration, before)
        try:
            found = probe(self.scene(surfels, environment, views, occasion.seed, kept), step, occasion)
            if stale is not None:
                found = with_refresh(found, stale, step, occasion)
        except NumericalFailure as failure:
            self.plan = EffectPlan()
            why = f"the probe failed: {failure.what}"
            self.evidence += (Evidence("plan", "on", why, iteration, occasion.seed, 0.0, None),)
            return not same_rays(before, self.plan)
        self.plan = replace(found.plan, kept=not found.plan.traces_all)
        self.evidence += found.evidence
        return not same_rays(before, self.plan)

    def scene(
        self,
        surfels: Surfels,
        environment: Float[Tensor, "rows columns 3"],
        views: Sequence[PosedImage],
        seed: int,
        kept: KeptLight | None = None,
    ) -> ProbeScene:
        """What a probe with this seed looks at; materials are still being learnt.

        Surfels with ``kept`` light are not traced: their light is compared with what rays of training find now. The
        model has been fitted to that light, and to what its rays met close by.
        """
        generator = torch.Generator(surfels.centre.device).manual_seed(seed)
        if self.share is None:
            # Computed once: surfels hardly move any more.
            self.share = image_share([view.camera for view in views], surfels)
        viewpoints = Viewpoints(drawn_views(views, seed), self.share, self.straight)
        others = None if kept is None else torch.nonzero(~kept.mask)[:, 0]
        rays = ProbeRays(self.samples, generator, self.rays)
        scene = trace_scene(surfels, environment, viewpoints, rays, among=others)
        # Below the horizon lies the surface itself, also for rays that start beyond it.
        clear = scene.incident.visibility * scene.untraced.visibility
        incident, untraced = replace(scene.incident, visibility=clear), scene.untraced
        if kept is not None:
            places = torch.nonzero(kept.mask)[:, 0]
            incident, untraced = incident.replaced(places, kept.anew), untraced.replaced(places, kept.light)
        return replace(scene, incident=incident, untraced=untraced, sharpest=SHARP_ROUGHNESS)

    def state(self) -> dict[str, Any]:
        """Everything needed to continue bit for bit."""
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


def drawn_views(views: Sequence[PosedImage], seed: int) -> tuple[ProbeView, ...]:
    """PROBE_VIEWS of the views, one drawn from each of as many equal parts of their list."""
    generator, count = torch.Generator().manual_seed(seed), min(PROBE_VIEWS, len(views))
    drawn = []
    for place in range(count):
        low, high = (len(views) * end // count for end in (place, place + 1))
        view = views[int(torch.randint(low, high, (), generator=generator))]
        drawn.append(ProbeView(view.camera, view.over(0.0)))
    return tuple(drawn)


def with_refresh(found: Findings, stale: Staleness, step: Step, occasion: Occasion) -> Findings:
    """The findings with the refresh interval decided too."""
    factor, record = decide_refresh(stale, found.tolerance, step, occasion, level_of(len(IN_TRAINING)))
    plan = replace(found.plan, refresh=min(factor, MOST_REFRESH_FACTOR))
    return replace(found, plan=plan, evidence=(*found.evidence, record))


def same_rays(first: EffectPlan, second: EffectPlan) -> bool:
    """Whether incident light that was gathered under one plan serves under the other."""
    one, other = first.traced, second.traced
    masks = one is other if one is None or other is None else torch.equal(one, other)
    fields = ("visibility", "indirect", "samples")
    return masks and all(getattr(first, name) == getattr(second, name) for name in fields)
