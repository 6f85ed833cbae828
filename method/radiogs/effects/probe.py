"""One probe: every effect is measured on the same images and decided; then the whole plan is measured once more."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

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
"""Probability that any bound of a run is too low, over all effects and probes."""

PROBES = 3
"""Number of probes in a run, at most."""

IN_TRAINING = ("visibility", "indirect", "specular", "view-dependence", "samples")
"""Effects that probes during training measure in images."""

COARSE_STEP = 2
"""Use every k-th view for the coarse first pass; it shows of most effects that they are needed."""


@dataclass(frozen=True)
class Occasion:
    """When a probe is made: its seed, the iteration of training, and the plan until then (for hysteresis)."""

    seed: int
    iteration: int = 0
    before: EffectPlan = field(default_factory=EffectPlan)


@dataclass(frozen=True)
class Findings:
    """What a probe has found: the plan, an ``Evidence`` for each effect, and one for the plan as a whole."""

    plan: EffectPlan
    evidence: tuple[Evidence, ...]
    tolerance: Tolerance


def level_of(effects: int) -> float:
    """Level of each bound with which all bounds hold together with an error of LEVEL.

    Each effect has two tries: left out altogether, and in part, in an order that ends at the first refusal.
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
    """Measure and decide. ``mse``: the method's own error, where the views have no targets to measure it against.

    Bounds hold with an error of LEVEL together over ``effects`` and PROBES.
    """
    few = replace(scene, views=scene.views[::COARSE_STEP])
    coarse = Assessment(few, step, occasion.seed, LEVEL, decibel, mse)
    assessment, measured = _measured_where_promising(coarse, scene, level_of(len(effects)), effects)
    decisions = {
        effect: _decided(assessment, occasion.before, [found for found in measured if found.effect == effect])
        for effect in effects
    }
    chosen = {effect: found.plan for effect, found in decisions.items() if found.verdict != "on"}
    plan, whole, left_out = accepted_plan(assessment, chosen, occasion.before, occasion.iteration)
    for effect in chosen.keys() - set(left_out):
        decisions[effect] = replace(
            decisions[effect], verdict="on", why="left out alone it would pass, with others it does not"
        )
    records = [
        Evidence(effect, found.verdict, found.why, occasion.iteration, occasion.seed, decibel, found.measured)
        for effect, found in decisions.items()
    ]
    return Findings(plan, (*records, whole), assessment.tolerance)


@dataclass(frozen=True)
class _Substitute:
    """A plan that leaves an effect out, altogether or in part, and what was measured for it."""

    effect: str
    plan: EffectPlan
    measured: Measured


@dataclass(frozen=True)
class _Decision:
    """What was decided for one effect. measured: for ``plan``, or for leaving the effect out altogether."""

    plan: EffectPlan
    verdict: Verdict
    why: str
    measured: Measured


def _measured_where_promising(
    coarse: Assessment, scene: ProbeScene, level: float, effects: Sequence[str]
) -> tuple[Assessment, list[_Substitute]]:
    """A coarse pass over few views, then all plans of the effects that may pass, from all views, with a ``level``.

    The coarse pass measures the most careful and the boldest plan of each effect. What it refuses needs no bound: to
    keep an effect is never wrong. Rays are not part of it: which surfels may go without depends on what all views see.
    Returns the assessment that is to decide, too.
    """
    assessment = coarse
    plans = {
        effect: [*partial_plans(effect, scene.surfels), plan_without(effect)]
        for effect in effects
        if effect != "visibility"
    }
    ends = [(effect, plan) for effect, each in plans.items() for plan in (*each[:-1][:1], each[-1])]
    measured = [_Substitute(*end, found) for end, found in zip(ends, assessment.measure(ends), strict=True)]
    promising = {each.effect for each in measured if each.measured.contribution < assessment.tolerance.decibel}
    asked: list[tuple[str, EffectPlan]] = []
    if promising or "visibility" in effects:
        assessment = coarse.of(scene, level)
    if "visibility" in effects:
        fewer = partial_ray_plans(assessment.radiance, OFF_BELOW * assessment.tolerance.error)
        asked = [("visibility", plan) for plan in (*fewer, plan_without("visibility"))]
    asked += [(effect, plan) for effect, each in plans.items() if effect in promising for plan in each]
    refused = [each for each in measured if each.effect not in promising]
    substitutes = [_Substitute(*each, found) for each, found in zip(asked, assessment.measure(asked), strict=True)]
    return assessment, [*substitutes, *refused]


def _decided(assessment: Assessment, before: EffectPlan, substitutes: Sequence[_Substitute]) -> _Decision:
    """The plan without the effect, if it passes; else the boldest of the partial plans up to the first refusal."""
    *careful, bold = substitutes
    decision = _Decision(bold.plan, *assessment.decided(bold.effect, bold.plan, bold.measured, before))
    if decision.verdict == "off" or bold.measured.share < LEAST_SHARE:
        return decision
    passed = []
    for each in careful:
        if assessment.by_images(each.effect, each.plan, each.measured, before)[0] == "on":
            # A plan that saves little is not refused by its images, and a bolder one may save enough.
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
    """All chosen plans combined, if that passes; else without the one that saves least, and so on.

    Effects interact: without indirect light, rays that some surfels keep for it only darken them. Returns the plan, its
    record, and the effects that it leaves out.
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
