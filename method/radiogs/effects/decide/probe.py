"""One probe: every effect measured on the same images, decided, and the plan of all decisions measured once more."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from radiogs_core.transport.plan import EffectPlan, everything

from ..measure.bounds import sidak
from ..measure.probe_scene import ProbeScene
from ..measure.step_cost import Step
from ..measure.substitutes import combined, partial_plans, partial_ray_plans, plan_without
from .assessment import Assessment
from .decision import LEAST_SHARE, OFF_BELOW
from .evidence import Evidence, Measured, Verdict
from .tolerance import TOLERANCE_DB, Tolerance

LEVEL = 0.01
"""Probability that any bound of a run is too low, over all effects and probes."""

PROBES = 3
"""Probes that a run has at most."""

IN_TRAINING = ("visibility", "indirect", "specular", "view-dependence", "samples")
"""What is probed of images during training."""

COARSE_STEP = 2
"""Every so many sights are enough to see that most effects are needed."""


@dataclass(frozen=True)
class Findings:
    """What a probe has found: the plan, an ``Evidence`` for each effect, and one for the plan as a whole."""

    plan: EffectPlan
    evidence: tuple[Evidence, ...]
    tolerance: Tolerance


def level_of(effects: int) -> float:
    """Of each bound, for all of them to hold together with an error of LEVEL.

    Two tries an effect: altogether, and in the order of the careful ways, which ends at the first refusal.
    """
    return sidak(LEVEL, 2 * effects * PROBES)


def probe(
    subject: ProbeScene,
    step: Step,
    seed: int,
    iteration: int = 0,
    before: EffectPlan | None = None,
    effects: Sequence[str] = IN_TRAINING,
    decibel: float = TOLERANCE_DB,
    mse: float | None = None,
) -> Findings:
    """Measure and decide. ``before``: the plan until now, which hysteresis keeps.

    ``mse``: the method's own error where the sights have no targets. Bounds hold with an error of LEVEL together over
    ``effects`` and PROBES.
    """
    level = level_of(len(effects))
    before = before or everything()
    glance = Assessment(replace(subject, sights=subject.sights[::COARSE_STEP]), step, seed, LEVEL, decibel, mse)
    judge, measured = _measured_where_promising(glance, subject, level, effects)
    settled = {
        effect: _settle(judge, before, [found for found in measured if found.effect == effect]) for effect in effects
    }
    chosen = {effect: found.plan for effect, found in settled.items() if found.verdict != "on"}
    plan, whole, left_out = _accepted(judge, chosen, before, iteration)
    for effect in chosen.keys() - set(left_out):
        settled[effect] = replace(
            settled[effect], verdict="on", why="left out alone it would pass, with others it does not"
        )
    records = [
        Evidence(effect, found.verdict, found.why, iteration, seed, decibel, found.measured)
        for effect, found in settled.items()
    ]
    return Findings(plan, (*records, whole), judge.tolerance)


@dataclass(frozen=True)
class _Substitute:
    """A way of leaving an effect out, and what was measured of it."""

    effect: str
    plan: EffectPlan
    measured: Measured


@dataclass(frozen=True)
class _Settled:
    """How one effect is left out, if it is: by ``plan``; measured of it, or of leaving the effect out altogether."""

    plan: EffectPlan
    verdict: Verdict
    why: str
    measured: Measured


def _measured_where_promising(
    at_a_glance: Assessment, subject: ProbeScene, level: float, effects: Sequence[str]
) -> tuple[Assessment, list[_Substitute]]:
    """The most careful and the boldest way at a glance; from all sights, with bounds of ``level``, all that may pass.

    What is refused at a glance needs no bound: to keep an effect is never wrong. Rays are not asked for at a glance:
    whom they may be taken from depends on what all sights see. Returns who is to decide, too.
    """
    judge = at_a_glance
    ways = {
        effect: [*partial_plans(effect, subject.surfels), plan_without(effect)]
        for effect in effects
        if effect != "visibility"
    }
    ends = [(effect, plan) for effect, plans in ways.items() for plan in (*plans[:-1][:1], plans[-1])]
    measured = [_Substitute(*end, found) for end, found in zip(ends, judge.measure(ends), strict=True)]
    promising = {way.effect for way in measured if way.measured.contribution < judge.tolerance.decibel}
    asked: list[tuple[str, EffectPlan]] = []
    if promising or "visibility" in effects:
        judge = at_a_glance.looking_at(subject, level)
    if "visibility" in effects:
        less = partial_ray_plans(judge.candidates, OFF_BELOW * judge.tolerance.error)
        asked = [("visibility", plan) for plan in (*less, plan_without("visibility"))]
    asked += [(effect, plan) for effect, plans in ways.items() if effect in promising for plan in plans]
    refused = [way for way in measured if way.effect not in promising]
    return judge, [
        *(_Substitute(*way, found) for way, found in zip(asked, judge.measure(asked), strict=True)),
        *refused,
    ]


def _settle(judge: Assessment, before: EffectPlan, ways: Sequence[_Substitute]) -> _Settled:
    """Altogether, if that passes; else the boldest of the careful ways up to the first that is refused."""
    *careful, bold = ways
    settled = _Settled(bold.plan, *judge.decided(bold.effect, bold.plan, bold.measured, before))
    if settled.verdict == "off" or bold.measured.share < LEAST_SHARE:
        return settled
    passed = []
    for way in careful:
        if judge.by_images(way.effect, way.plan, way.measured, before)[0] == "on":
            # What saves little is not refused, but not worth it: a bolder plan may be.
            if way.measured.share < LEAST_SHARE:
                continue
            break
        passed.append(way)
    for way in reversed(passed):
        verdict, why, measured = judge.decided(way.effect, way.plan, way.measured, before)
        if verdict == "off":
            return _Settled(way.plan, "local", why, measured)
    return settled


def _accepted(
    judge: Assessment, chosen: Mapping[str, EffectPlan], before: EffectPlan, iteration: int
) -> tuple[EffectPlan, Evidence, list[str]]:
    """What was chosen for each effect, combined, if that passes; else without the one that saves least, and so on.

    Effects interact: without indirect light, rays that some surfels keep for it only darken them. Returns the plan, its
    record, and the effects that it leaves out.
    """
    left = sorted(chosen, key=lambda effect: -judge.step.saving(chosen[effect], everything()))
    while left:
        plan = everything()
        for effect in left:
            plan = combined(plan, chosen[effect])
        verdict, why, measured = judge.decided("plan", plan, judge.measure([("plan", plan)])[0], before)
        if verdict == "off":
            return plan, Evidence("plan", "off", why, iteration, judge.seed, judge.tolerance.decibel, measured), left
        left.pop()
    why = "nothing is left out"
    return everything(), Evidence("plan", "on", why, iteration, judge.seed, judge.tolerance.decibel, None), left
