"""A probe: measures how plans change the images of a scene, and decides about every effect and the whole plan."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.kernels.image.display import displayed
from radiogs_core.kernels.rasterize.rasterize import blend
from radiogs_core.transport.plan import HIGHEST_DEGREE, EffectPlan
from radiogs_core.transport.tracer import EVERYTHING

from .bounds import bootstrap_t, sidak
from .decision import TOLERANCE_DB, Evidence, Measured, Tolerance, Verdict, decide
from .images import CoveredPixels, ReferenceImage, mean_error, rendered_views, tile_errors
from .plans import Step, combined, plan_without
from .probe_scene import PlanRadiance, ProbeScene

LEVEL = 0.01
"""Probability that any bound of a run is wrong, over all effects and probes."""

PROBES = 2
"""Number of probes in a training."""


@dataclass(frozen=True)
class Occasion:
    """The time of a probe, and its seed."""

    seed: int
    """Seed of the probe's directions and resamples."""
    iteration: int = 0
    """Iteration of training."""
    before: EffectPlan = field(default_factory=EffectPlan)
    """The plan until now, for hysteresis."""


@dataclass(frozen=True)
class Findings:
    """The result of a probe."""

    plan: EffectPlan
    """The effects to simulate."""
    evidence: tuple[Evidence, ...]
    """A record for each effect, and one for the plan as a whole."""
    tolerance: Tolerance
    """The tolerated loss, with the method's own error."""

    def extended(self, record: Evidence, **changes: Any) -> "Findings":
        """The findings with a further record, and with ``changes`` of the plan's fields."""
        return replace(self, plan=replace(self.plan, **changes), evidence=(*self.evidence, record))


@dataclass(frozen=True)
class Decision:
    """The decision about one effect, or about the whole plan."""

    plan: EffectPlan
    """The chosen plan; for the verdict "on", the plan without the effect, which was refused."""
    verdict: Verdict
    why: str
    """The reason, in words."""
    measured: Measured | None
    """Measurements of ``plan``; None if nothing is left out."""


def probe(
    scene: ProbeScene,
    step: Step,
    occasion: Occasion,
    effects: Sequence[str],
    decibel: float = TOLERANCE_DB,
    mse: float | None = None,
) -> Findings:
    """Measures ``effects`` on the scene and decides about each of them and about the whole plan.

    ``decibel``: tolerated loss, dB of PSNR. ``mse``: the method's own error, display sRGB, if the views have no
    targets; None: it is measured. All bounds of ``effects`` and PROBES hold together with an error of LEVEL: each
    effect is tried alone and together with others, in an order that ends when a combination passes. Raises
    NumericalFailure if a surfel in a view has a radiance that is not finite.
    """
    level = sidak(LEVEL, 2 * len(effects) * PROBES)
    assessment = Assessment(scene, step, occasion, level, decibel, mse)
    plans = {effect: plan_without(effect) for effect in effects}
    decisions = {effect: assessment.decided(plan, assessment.measure(effect, plan)) for effect, plan in plans.items()}
    chosen = {effect: each for effect, each in decisions.items() if each.verdict != "on"}
    whole, left_out = accepted_plan(assessment, chosen)
    for effect in chosen.keys() - set(left_out):
        why = "it passes if left out alone, but not together with others"
        decisions[effect] = replace(decisions[effect], verdict="on", why=why)
    records = tuple(
        Evidence(effect, each.verdict, each.why, occasion.iteration, occasion.seed, decibel, each.measured)
        for effect, each in (*decisions.items(), ("plan", whole))
    )
    return Findings(whole.plan, records, assessment.tolerance)


def accepted_plan(assessment: "Assessment", chosen: Mapping[str, Decision]) -> tuple[Decision, list[str]]:
    """The decision about the accepted plan, and the effects that it leaves out.

    It combines all chosen plans, if the combination passes; if not, the plan that saves least is dropped, and so on.
    """
    left = sorted(chosen, key=lambda effect: -assessment.step.saving(chosen[effect].plan))
    while len(left) > 1:
        plan = combined(chosen[effect].plan for effect in left)
        found = assessment.decided(plan, assessment.measure("plan", plan))
        if found.verdict == "off":
            return found, left
        left.pop()
    if left:
        return replace(chosen[left[0]], verdict="off"), left
    return Decision(EffectPlan(), "on", "nothing is left out", None), left


def light_factor_is_free(effect: str, scene: ProbeScene) -> bool:
    """Whether a factor on the light may compensate a change of all pixels that the missing effect causes."""
    return effect != "view-dependence" and not scene.given_light


class Assessment:
    """Measures plans by comparison with the images of a scene with all effects on.

    ``level``: error probability of each bound. ``decibel``: tolerated loss, dB of PSNR, relative to ``mse``. ``mse``:
    the method's own mean squared error, display sRGB; None: the smaller of the errors of the shaded images and of the
    surfels' own radiance, against the views' targets.
    """

    def __init__(
        self, scene: ProbeScene, step: Step, occasion: Occasion, level: float, decibel: float, mse: float | None
    ) -> None:
        self.scene, self.step, self.before, self.level = scene, step, occasion.before, level
        self.generator = torch.Generator().manual_seed(occasion.seed)
        self.radiance = PlanRadiance(scene)
        full = {"shaded": self.radiance.shaded(EVERYTHING).detach(), "own": self.radiance.own(HIGHEST_DEGREE)}
        rendered = rendered_views(self.radiance.projections, full.values())
        self.pixels = CoveredPixels.of(scene.views, rendered, scene.straight)
        images = zip(full, self.pixels.take(rendered), strict=True)
        self.full = {name: ReferenceImage.of(image, self.pixels) for name, image in images}
        if mse is None:
            mse = min(mean_error(image, self.pixels) for image in self.full.values())
        self.tolerance = Tolerance(mse, decibel)

    def was_left_out(self, plan: EffectPlan) -> bool:
        """Whether ``plan`` saves no more work than the one before; a plan that saves more passes a stricter rule."""
        return bool(self.before.off) and self.step.saving(plan) <= self.step.saving(self.before)

    def by_images(self, plan: EffectPlan, measured: Measured) -> tuple[Verdict, str]:
        """Verdict and reason by images, and by the gradient if ``measured`` has it."""
        return decide(measured, self.was_left_out(plan), self.tolerance.decibel)

    def decided(self, plan: EffectPlan, measured: Measured) -> Decision:
        """The decision by images and gradients. Gradients cost most: a plan that the images refuse needs none."""
        verdict, why = self.by_images(plan, measured)
        if verdict == "off" and replace(plan, sh_degree=HIGHEST_DEGREE).off:
            measured = replace(measured, gradient=self.gradient_change(plan))
            verdict, why = self.by_images(plan, measured)
        return Decision(plan, verdict, why, measured)

    @cached_property
    def upstream(self) -> Float[Tensor, "surfels views 3"]:
        """Gradient of the images' error with respect to the surfels' radiance; the same for every plan."""
        return image_gradient(self.radiance)

    @cached_property
    def full_gradients(self) -> list[Tensor]:
        """``gradients`` with all effects on."""
        return self.gradients(EVERYTHING)

    def gradients(self, plan: EffectPlan) -> list[Tensor]:
        """Gradients of that error for albedo, roughness and light under a plan, in the order of the leaves."""
        leaves, sent = list(self.radiance.leaves.values()), self.radiance.shaded(plan)
        return list(torch.autograd.grad(sent, leaves, self.upstream, retain_graph=True, materialize_grads=True))

    def gradient_change(self, plan: EffectPlan) -> float:
        """Largest |g_plan - g_full| / |g_full| over the leaves; infinite where only g_full is zero.

        An effect that hardly changes images may carry the only gradient. Roughness counts only if the plan has specular
        lobes: without them it is not learnt on purpose.
        """
        pairs = zip(self.radiance.leaves, self.gradients(plan), self.full_gradients, strict=True)
        return max(_relative(value - full, full) for name, value, full in pairs if plan.specular or name != "roughness")

    def measure(self, effect: str, plan: EffectPlan) -> Measured:
        """Loss of a plan, which leaves ``effect`` out, compared with all effects on."""
        sent = self._changed(plan)
        images = self.pixels.take(rendered_views(self.radiance.projections, sent.values()))
        free, tolerance = light_factor_is_free(effect, self.scene), self.tolerance
        errors = [
            tile_errors(image, self.full[name], self.pixels, free) for name, image in zip(sent, images, strict=True)
        ]
        weighted = torch.cat([each.weighted for each in errors])
        below, above = bootstrap_t(weighted, self.level, self.generator)
        worst_tile = max(float(each.difference.max()) for each in errors)
        tail = worst_tile / tolerance.local_error if tolerance.local_error > 0 else float(worst_tile > 0)
        return Measured(
            contribution=tolerance.loss(float(weighted.double().mean(1).max())),
            lowest=tolerance.loss(float(below.max())),
            bound=tolerance.loss(float(above.max())),
            worst=tolerance.worst_case(float(above[::2].max())),  # of the differences; the others are rises
            tail=tail,
            share=self.step.saving(plan),
            rays=round(self.step.work(EVERYTHING)["rays"] - self.step.work(plan)["rays"]),
        )

    def _changed(self, plan: EffectPlan) -> dict[str, Float[Tensor, "surfels views 3"]]:
        """Linear radiance under a plan for the images that the plan changes, by their names in ``full``."""
        sent = {}
        if plan.sh_degree < HIGHEST_DEGREE:
            sent["own"] = self.radiance.own(plan.sh_degree)
        if replace(plan, sh_degree=HIGHEST_DEGREE).off:
            sent["shaded"] = self.radiance.shaded(plan).detach()
        return sent


def image_gradient(radiance: PlanRadiance) -> Float[Tensor, "surfels views 3"]:
    """Gradient of the images' squared error with respect to the radiance of each surfel towards each view.

    The error is the mean over pixels and channels, display sRGB. The gradient is zero for views without a target.
    """
    sent = radiance.shaded(EVERYTHING).detach().requires_grad_()
    total = sent.new_zeros(())
    for index, (view, projection) in enumerate(zip(radiance.scene.views, radiance.projections, strict=True)):
        if view.target is not None:
            raster = blend(projection, sent[:, index], 1.0)
            image = displayed(raster.features, raster.alpha, radiance.scene.straight)
            total = total + (image - view.target).square().mean()
    return torch.autograd.grad(total, sent)[0] if total.requires_grad else torch.zeros_like(sent)


def _relative(change: Tensor, whole: Tensor) -> float:
    moved, length = float(change.norm()), float(whole.norm())
    if length > 0:
        return moved / length
    return 0.0 if moved == 0 else float("inf")
