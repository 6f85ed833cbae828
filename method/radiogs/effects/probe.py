"""A probe: measures and decides every effect on the same images, then measures the whole plan once more."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from radiogs_core.transport.plan import EffectPlan

from .assessment import Assessment
from .bounds import sidak
from .decision import LEAST_SHARE, OFF_BELOW
from .evidence import Evidence, Measured, Verdict
from .probe_scene import ProbeScene
from .step_cost import Step
from .substitutes import combined, partial_plans, partial_ray_plans, plan_without
from .tolerance import TOLERANCE_DB, Tolerance

LEVEL = 0.01
"""Probability that any bound of a run is wrong, over all effects and probes."""

PROBES = 3
"""Number of probes in a run, at most."""

IN_TRAINING = ("visibility", "indirect", "specular", "view-dependence", "samples")
"""Effects whose influence on images a probe measures during training."""

COARSE_STEP = 2
"""Use every k-th view for the coarse first pass, which shows for most effects that they are needed."""


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


def level_of(effects: int) -> float:
    """Level of each bound such that all bounds of a run hold together with an error of LEVEL.

    Each effect is tried twice: left out completely, and in part, in an order that ends at the first refusal.
    """
    return sidak(LEVEL, 2 * effects * PROBES)


def probe(
    scene: ProbeScene,
    step: Step,
    occasion: Occasion,
    effects: Sequence[str] = IN_TRAINING,
    decibel: float = TOLERANCE_DB,
    mse: float | None = None,
) -> Findings:
    """Measures ``effects`` on the scene and decides about each of them and about the whole plan.

    ``decibel``: tolerated loss, dB of PSNR. ``mse``: the method's own error, display sRGB, if the views have no
    targets; None: it is measured. All bounds of ``effects`` and PROBES hold together with an error of LEVEL. Raises
    NumericalFailure if a surfel in a view has a radiance that is not finite.
    """
    few = replace(scene, views=scene.views[::COARSE_STEP])
    coarse = Assessment(few, step, occasion.seed, LEVEL, decibel, mse)
    assessment, measured = _measured_where_promising(coarse, scene, level_of(len(effects)), effects)
    decisions = {
        effect: _decided(assessment, occasion.before, [each for each in measured if each.effect == effect])
        for effect in effects
    }
    chosen = {effect: decision.plan for effect, decision in decisions.items() if decision.verdict != "on"}
    plan, whole, left_out = accepted_plan(assessment, chosen, occasion.before, occasion.iteration)
    for effect in chosen.keys() - set(left_out):
        decisions[effect] = replace(
            decisions[effect], verdict="on", why="it passes if left out alone, but not together with others"
        )
    records = [
        Evidence(effect, each.verdict, each.why, occasion.iteration, occasion.seed, decibel, each.measured)
        for effect, each in decisions.items()
    ]
    return Findings(plan, (*records, whole), assessment.tolerance)


@dataclass(frozen=True)
class _Substitute:
    """A plan that leaves an effect out, completely or in part, with its measurements."""

    effect: str
    plan: EffectPlan
    measured: Measured


@dataclass(frozen=True)
class _Decision:
    """The decision about one effect."""

    plan: EffectPlan
    """The chosen plan; for the verdict "on", the plan without the effect, which was refused."""
    verdict: Verdict
    why: str
    """The reason, in words."""
    measured: Measured
    """Measurements of ``plan``."""


def _measured_where_promising(
    coarse: Assessment, scene: ProbeScene, level: float, effects: Sequence[str]
) -> tuple[Assessment, list[_Substitute]]:
    """The assessment to decide with, and the measured plans: by a coarse pass over few views, then over all views.

    The coarse pass measures the most careful and the boldest plan of each effect. An effect that it refuses needs no
    bound, because to keep an effect is never wrong. Rays are not part of it: the surfels that need no rays depend on
    all views. All plans of the other effects are then measured from all views, with bounds of error ``level``.
    """
    assessment = coarse
    plans = {
        effect: [*partial_plans(effect, scene.surfels), plan_without(effect)]
        for effect in effects
        if effect != "visibility"
    }
    ends = [(effect, plan) for effect, each in plans.items() for plan in (*each[:-1][:1], each[-1])]
    measured = [_Substitute(*end, values) for end, values in zip(ends, assessment.measure(ends), strict=True)]
    promising = {each.effect for each in measured if each.measured.contribution < assessment.tolerance.decibel}
    candidates: list[tuple[str, EffectPlan]] = []
    if promising or "visibility" in effects:
        assessment = coarse.of(scene, level)
    if "visibility" in effects:
        fewer = partial_ray_plans(assessment.radiance, OFF_BELOW * assessment.tolerance.error)
        candidates = [("visibility", plan) for plan in (*fewer, plan_without("visibility"))]
    candidates += [(effect, plan) for effect, each in plans.items() if effect in promising for plan in each]
    refused = [each for each in measured if each.effect not in promising]
    values = assessment.measure(candidates)
    substitutes = [_Substitute(*each, value) for each, value in zip(candidates, values, strict=True)]
    return assessment, [*substitutes, *refused]


def _decided(assessment: Assessment, before: EffectPlan, substitutes: Sequence[_Substitute]) -> _Decision:
    """The plan without the effect, if it passes; else the boldest partial plan before the first refusal."""
    *careful, bold = substitutes
    decision = _Decision(bold.plan, *assessment.decided(bold.effect, bold.plan, bold.measured, before))
    if decision.verdict == "off" or bold.measured.share < LEAST_SHARE:
        return decision
    passed = []
    for each in careful:
        if assessment.by_images(each.effect, each.plan, each.measured, before)[0] == "on":
            # This plan is refused for its small saving, not for its images; a bolder one may save enough.
            if each.measured.share < LEAST_SHARE:
                continue
            break
        passed.append(each)
    for each in reversed(passed):
        verdict, why, measured = assessment.decided(each.effect, each.plan, each.measured, before)
        if verdict == "off":
            return _Decision(each.plan, "local", why, measured)
    return decision


def accepted_plan(
    assessment: Assessment, chosen: Mapping[str, EffectPlan], before: EffectPlan, iteration: int
) -> tuple[EffectPlan, Evidence, list[str]]:
    """The accepted plan, its record, and the effects that it leaves out.

    It combines all chosen plans, if the combination passes; if not, the plan that saves least is dropped, and so on.
    Effects interact: without indirect light, rays that some surfels keep for it only darken them.
    """
    left = sorted(chosen, key=lambda effect: -assessment.step.saving(chosen[effect], EffectPlan()))
    seed, decibel = assessment.seed, assessment.tolerance.decibel
    while left:
        plan = EffectPlan()
        for effect in left:
            plan = combined(plan, chosen[effect])
        verdict, why, measured = assessment.decided("plan", plan, assessment.measure([("plan", plan)])[0], before)
        if verdict == "off":
            return plan, Evidence("plan", "off", why, iteration, seed, decibel, measured), left
        left.pop()
    return EffectPlan(), Evidence("plan", "on", "nothing is left out", iteration, seed, decibel, None), left
