"""One probe: every effect measured on the same images, decided, and the plan of all decisions measured once more."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from ..colour import srgb_encode
from .bounds import Bootstrap, sidak, zero_events_upper
from .candidates import Candidates
from .decision import LEAST_SHARE, decide
from .evidence import Evidence, Measured, Verdict
from .gradient import Gradients
from .images import TileErrors, mean_error, same_light, splatted, tile_errors
from .plan import HIGHEST_DEGREE, EffectPlan, everything
from .prices import Step, cost
from .subject import Subject
from .tolerance import TOLERANCE_DB, Tolerance

LEVEL = 0.01
"""Probability that any bound of a run is too low, over all effects and probes."""

PROBES = 4
"""Probes that a run has at most."""

OCCLUSION_EDGES = (0.05, 0.1, 0.2, 0.4)
"""Rays may be left to the surfels that have more than one of these shares of their sky hidden."""

ROUGHNESS_EDGES = (0.7, 0.6, 0.5, 0.3)
"""Specular parts may be left to the surfels that are smoother than one of these."""

IN_TRAINING = ("visibility", "indirect", "specular", "view-dependence", "samples")
"""What is probed of images during training."""

GLANCE = 4
"""Every so many sights are enough to see that most effects are needed."""

NO_GAUGE = ("view-dependence", "samples")
"""Effects whose absence no factor on the light takes back."""


@dataclass(frozen=True)
class Findings:
    """What a probe has found: the plan, an ``Evidence`` for each effect, and one for the plan as a whole."""

    plan: EffectPlan
    evidence: tuple[Evidence, ...]
    tolerance: Tolerance


def offers(subject: Subject, effect: str) -> list[EffectPlan]:
    """Ways of leaving an effect out, from the most careful to the boldest: each leaves out what the one before does.

    Rays are needed for visibility as for indirect light; so visibility is only ever given up with both.
    """
    full = everything()
    if effect == "visibility":
        occlusion = subject.occlusion
        masks = [occlusion > edge for edge in OCCLUSION_EDGES]
        return [*(EffectPlan(traced=mask) for mask in masks), full.without("indirect").without("visibility")]
    if effect == "specular":
        roughness = subject.surfels.roughness
        masks = [roughness < edge for edge in ROUGHNESS_EDGES]
        return [*(EffectPlan(specular_at=mask) for mask in masks), full.without("specular")]
    if effect == "view-dependence":
        return [EffectPlan(sh_degree=degree) for degree in reversed(range(HIGHEST_DEGREE))]
    return [full.without(effect)]


def probe(
    subject: Subject,
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
    # Two tries an effect: altogether, and in the order of the careful ways, which ends at the first refusal.
    level = sidak(LEVEL, 2 * len(effects) * PROBES)
    before = before or everything()
    ways = [(effect, plan) for effect in effects for plan in offers(subject, effect)]
    glance = _Judge(replace(subject, sights=subject.sights[::GLANCE]), step, seed, LEVEL, decibel, mse)
    judge, measured = _measured_where_promising(glance, subject, level, ways)
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
class _Way:
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
    at_a_glance: "_Judge", subject: Subject, level: float, ways: Sequence[tuple[str, EffectPlan]]
) -> tuple["_Judge", list[_Way]]:
    """All ways at a glance; from all sights, with bounds of ``level``, those that may pass, if there are any.

    What is refused at a glance needs no bound: to keep an effect is never wrong. Returns who is to decide, too.
    """
    judge, found = at_a_glance, at_a_glance.measure(ways)
    promising = [place for place, each in enumerate(found) if each.contribution < judge.tolerance.decibel]
    if promising:
        judge = at_a_glance.looking_at(subject, level)
        for place, each in zip(promising, judge.measure([ways[place] for place in promising]), strict=True):
            found[place] = each
    return judge, [_Way(*way, each) for way, each in zip(ways, found, strict=True)]


def _settle(judge: "_Judge", before: EffectPlan, ways: Sequence[_Way]) -> _Settled:
    """Altogether, if that passes; else the boldest of the careful ways up to the first that is refused."""
    *careful, bold = ways
    settled = _Settled(bold.plan, *judge.decided(bold.effect, bold.plan, bold.measured, before))
    if settled.verdict == "off" or bold.measured.share < LEAST_SHARE:
        return settled
    for way in careful:
        if way.measured.share < LEAST_SHARE:
            continue  # what saves little is not refused, but not worth it: a bolder plan may be
        verdict, why, measured = judge.decided(way.effect, way.plan, way.measured, before)
        if verdict == "on":
            break
        settled = _Settled(way.plan, "local", why, measured)
    return settled


def _accepted(
    judge: "_Judge", chosen: Mapping[str, EffectPlan], before: EffectPlan, iteration: int
) -> tuple[EffectPlan, Evidence, list[str]]:
    """What was chosen for each effect, joined, if that passes; else without the one that saves least, and so on.

    Effects interact: without indirect light, rays that some surfels keep for it only darken them. Returns the plan, its
    record, and the effects that it leaves out.
    """
    left = sorted(chosen, key=lambda effect: -judge.step.saving(chosen[effect], everything()))
    while left:
        plan = everything()
        for effect in left:
            plan = _joined(plan, chosen[effect])
        verdict, why, measured = judge.decided("plan", plan, judge.measure([("plan", plan)])[0], before)
        if verdict == "off":
            return plan, Evidence("plan", "off", why, iteration, judge.seed, judge.tolerance.decibel, measured), left
        left.pop()
    why = "nothing is left out"
    return everything(), Evidence("plan", "on", why, iteration, judge.seed, judge.tolerance.decibel, None), left


_FIELDS: Mapping[str, tuple[str, ...]] = {
    "visibility": ("visibility", "indirect", "traced"),
    "indirect": ("visibility", "indirect", "traced"),
    "bounces": ("bounces",),
    "specular": ("specular", "specular_at"),
    "light-sampling": ("light_sampling",),
    "view-dependence": ("sh_degree",),
    "samples": ("samples",),
    "refresh": ("refresh",),
}
"""Fields of a plan that say how an effect is left out."""


def _only(plan: EffectPlan, effect: str) -> EffectPlan:
    return replace(everything(), **{name: getattr(plan, name) for name in _FIELDS[effect]})


def _joined(first: EffectPlan, second: EffectPlan) -> EffectPlan:
    """Everything that either plan leaves out; of two masks of rays the bolder plan's one."""
    traced = None
    if first.traces and second.traces:
        traced = first.traced if second.traced is None else second.traced
    return EffectPlan(
        visibility=first.visibility and second.visibility,
        indirect=first.indirect and second.indirect,
        bounces=first.bounces and second.bounces,
        specular=first.specular and second.specular,
        light_sampling=first.light_sampling and second.light_sampling,
        sh_degree=min(first.sh_degree, second.sh_degree),
        samples=max(first.samples, second.samples),
        refresh=max(first.refresh, second.refresh),
        traced=traced,
        specular_at=first.specular_at if second.specular_at is None else second.specular_at,
    )


class _Judge:
    """Measures plans against the full images of a subject."""

    def __init__(
        self, subject: Subject, step: Step, seed: int, level: float, decibel: float, mse: float | None
    ) -> None:
        self.subject, self.step, self.seed, self.mse = subject, step, seed, mse
        self.level = level
        self.bootstrap = Bootstrap(level, torch.Generator().manual_seed(seed))
        self.candidates = Candidates(subject)
        self.gradients = Gradients(self.candidates)
        full = {
            "shaded": self.candidates.radiance(everything()).detach(),
            "own": self.candidates.own(HIGHEST_DEGREE),
        }
        if subject.sharpest is not None:
            full["sharp"] = self.candidates.radiance(everything(), sharp=True).detach()
        self.full, self.covered = splatted(subject.sights, subject.surfels, full)
        if mse is None:
            mse = min(mean_error(self.full[name], subject.sights, self.covered) for name in ("shaded", "own"))
        self.tolerance = Tolerance(mse, decibel)

    def looking_at(self, subject: Subject, level: float) -> "_Judge":
        """The same, of another subject with another level of error."""
        return _Judge(subject, self.step, self.seed, level, self.tolerance.decibel, self.mse)

    def was_left_out(self, plan: EffectPlan, before: EffectPlan) -> bool:
        """Whether ``before`` left out as much already: what is new has to pass the stricter rule."""
        return bool(before.off) and self.step.saving(plan, everything()) <= self.step.saving(before, everything())

    def decided(
        self, effect: str, plan: EffectPlan, measured: Measured, before: EffectPlan
    ) -> tuple[Verdict, str, Measured]:
        """The rule, with what ``before`` left out for the same effect as the past.

        Gradients cost as much as all else, and are asked for last: what is refused by its images needs none.
        """
        past = before if effect == "plan" else _only(before, effect)
        was_off = self.was_left_out(plan, past)
        verdict, why = decide(measured, was_off, self.tolerance.decibel)
        if verdict == "off" and replace(plan, sh_degree=HIGHEST_DEGREE).off:
            measured = replace(measured, gradient=self.gradients.change(plan))
            verdict, why = decide(measured, was_off, self.tolerance.decibel)
        return verdict, why, measured

    def measure(self, asked_of: Sequence[tuple[str, EffectPlan]]) -> list[Measured]:
        """What each plan, made for an effect, loses against everything."""
        plans = [plan for _, plan in asked_of]
        asked: dict[tuple[int, str], Float[Tensor, "surfels views 3"]] = {}
        for place, plan in enumerate(plans):
            if plan.sh_degree < HIGHEST_DEGREE:
                asked[place, "own"] = self.candidates.own(plan.sh_degree)
            if replace(plan, sh_degree=HIGHEST_DEGREE).off:
                asked[place, "shaded"] = self.candidates.radiance(plan).detach()
            if "sharp" in self.full and "specular" in plan.off:
                asked[place, "sharp"] = self.candidates.radiance(plan, sharp=True).detach()
        names = {key: f"{key[0]} {key[1]}" for key in asked}
        images, _ = splatted(
            self.subject.sights, self.subject.surfels, {names[key]: value for key, value in asked.items()}
        )
        errors = {
            key: tile_errors(
                images[names[key]], self.full[key[1]], self.subject.sights, self.covered,
                scaled=asked_of[key[0]][0] not in NO_GAUGE,
            )
            for key in asked
        }  # fmt: skip
        bounds = self._bounds(errors)
        return [
            self._measured(
                plan,
                {kind: errors[where, kind] for where, kind in errors if where == place},
                {kind: bounds[where, kind] for where, kind in bounds if where == place},
            )
            for place, plan in enumerate(plans)
        ]

    def _bounds(self, errors: Mapping[tuple[int, str], TileErrors]) -> dict[tuple[int, str], "_Bounds"]:
        """Of the mean difference and the mean rise; sharp images have no target, and so no rise."""
        stacked = torch.cat([torch.stack([each.weighted_difference, each.weighted_rise]) for each in errors.values()])
        below, above = self.bootstrap.bounds(stacked)
        mean = stacked.double().mean(1).cpu()
        found = {}
        for place, key in enumerate(errors):
            rows = slice(2 * place, 2 * place + (1 if key[1] == "sharp" else 2))
            found[key] = _Bounds(
                float(mean[rows].max()), float(below[rows].max()), float(above[rows].max()), float(above[2 * place])
            )
        return found

    def _measured(
        self,
        plan: EffectPlan,
        errors: Mapping[str, TileErrors],
        bounds: Mapping[str, "_Bounds"],
    ) -> Measured:
        tolerance = self.tolerance
        worst_tile = max(float(each.difference.max()) for each in errors.values())
        tail = worst_tile / tolerance.local_error if tolerance.local_error > 0 else float(worst_tile > 0)
        tiles = len(next(iter(errors.values())).difference)
        saved = self.step.work(everything())["rays"] - self.step.work(plan)["rays"]
        seconds = 1e-6 * (cost(self.step.work(everything())) - cost(self.step.work(plan)))
        return Measured(
            contribution=max(tolerance.loss(each.mean) for each in bounds.values()),
            lowest=max(tolerance.loss(each.below) for each in bounds.values()),
            bound=max(tolerance.loss(each.above) for each in bounds.values()),
            worst=max(tolerance.worst_case(each.difference) for each in bounds.values()),
            tail=tail,
            unseen=zero_events_upper(tiles, self.level) if tail < 1 else 1.0,
            gradient=0.0,
            share=self.step.saving(plan, everything()),
            rays=round(saved),
            seconds=seconds,
        )


@dataclass(frozen=True)
class _Bounds:
    """Of an error: estimate, bounds from both sides, and the upper bound of the difference alone."""

    mean: float
    below: float
    above: float
    difference: float


def difference_maps(
    subject: Subject, effects: Sequence[str]
) -> tuple[Float[Tensor, "height width 3"], dict[str, Float[Tensor, "height width"]]]:
    """The first sight with everything on, and how much leaving each effect out changes each pixel, mean over channels.

    Both in display sRGB.
    """
    candidates, first = Candidates(subject), replace(subject, sights=subject.sights[:1])
    plans = {effect: offers(subject, effect)[-1] for effect in effects}
    radiance = {"shaded": candidates.radiance(everything()), "own": candidates.own(HIGHEST_DEGREE)}
    for effect, plan in plans.items():
        own = plan.sh_degree < HIGHEST_DEGREE
        radiance[effect] = candidates.own(plan.sh_degree) if own else candidates.radiance(plan)
    seen = {name: value[:, :1].detach() for name, value in radiance.items()}
    images, covered = splatted(first.sights, subject.surfels, seen)
    maps = {}
    for effect, plan in plans.items():
        full = images["own" if plan.sh_degree < HIGHEST_DEGREE else "shaded"]
        factor = torch.ones(3) if effect in NO_GAUGE else same_light(images[effect], full, covered)
        change = srgb_encode(images[effect][0] * factor.to(full[0])) - srgb_encode(full[0])
        maps[effect] = change.abs().mean(-1)
    return srgb_encode(images["shaded"][0]), maps
