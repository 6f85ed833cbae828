"""What a long run takes: few steps of every kind at full size, and its memory by formula.

The steps are for a rehearsal (``radiogs_core.capabilities.Rehearsing``). The formula gives bytes of the phases of a run
for numbers of surfels, pixels and rays: what stays between steps follows from the shapes of what is kept, and what a
step takes beside that is a number of bytes for each surfel, pixel, ray and hit, found with the CPU's allocator;
``tests/method/radiogs/test_memory.py`` compares the sums with what is measured. Nothing has an entry for each harmonic
of each sample.
"""

from dataclasses import dataclass, replace
from typing import get_args

from radiogs_core.capabilities import MemoryPhase, Relighting, ShortRun, StepKind, TrainingImages
from radiogs_core.transport.light_filters import filters_bytes
from radiogs_core.transport.splitsum import LARGEST_HEIGHT
from radiogs_core.transport.tracer import RAYS_AT_ONCE

from .settings import Budget, Variant
from .settings import Relighting as Mode

INITIALISE_STEPS = 12
"""Steps of stage 1: schedules go by the share of steps that are done, so that every harmonic and loss has its turn."""

DENSIFY_EVERY = 3
"""Steps between two of its rounds of density control."""

PRUNED_AFTER = 11
"""Steps of stage 1 after which surfels that hardly show are looked for in all training views: no round is due then."""

INVERT_STEPS = 6
"""Steps of stage 2."""

REFRESH_EVERY = 4
"""Steps after which all light is traced anew."""

FINETUNE_STEPS = 3
"""Steps of fine-tuning: the first, which is not counted, and two that are."""

TITLES = {
    "pbr": "by rays, split sum",
    "finetuned": "by rays, fine-tuned",
    "surfels": "by surfels alone, fine-tuned",
}


def sizes(budget: Budget) -> tuple[int, int]:
    """Surfels at the start, and at most."""
    geometry = budget.geometry
    return min(geometry.initial_surfels, geometry.maximum_surfels), geometry.maximum_surfels


def short_run(variant: Variant, budget: Budget, size: int) -> ShortRun:
    """A run that begins with ``size`` surfels and may not have more.

    They fill the visual hull, whatever the variant starts from; those of a trained model lie on surfaces. Those that
    hardly show are looked for once, and stay: most of a hull hardly shows, and the model is to keep its size.
    """
    short = replace(
        budget,
        geometry=replace(
            budget.geometry,
            steps=INITIALISE_STEPS,
            initial_surfels=size,
            maximum_surfels=size,
            densify_interval=DENSIFY_EVERY,
        ),
        inverse_iterations=INVERT_STEPS,
        refresh_interval=REFRESH_EVERY,
        finetune_iterations=min(FINETUNE_STEPS, budget.finetune_iterations),
    )
    kinds = {
        "initialise": _kinds(_density_kinds(variant, budget), budget.geometry.steps, INITIALISE_STEPS),
        "invert": _kinds((), budget.inverse_iterations, INVERT_STEPS),
    }
    if variant.shading == "monte-carlo" and variant.incident != "precomputed":
        refreshed, whole = frozenset({REFRESH_EVERY}), (budget.inverse_iterations - 1) // budget.refresh_interval
        tracing = StepKind("step that traces all light anew", refreshed, whole)
        kinds["invert"] = _kinds((tracing,), budget.inverse_iterations, INVERT_STEPS)
    modes = [mode for mode in get_args(Mode) if mode in TITLES]
    steps = {mode: 0 if mode == "pbr" else budget.finetune_iterations for mode in modes}
    rehearsed = _in_the_hull(_pruning_once(variant))
    ways = tuple(Relighting(TITLES[mode], replace(rehearsed, relighting=mode), steps[mode]) for mode in modes)
    return ShortRun(rehearsed, short, kinds, ways)


def _pruning_once(variant: Variant) -> Variant:
    """Surfels that hardly show are looked for once in the short stage 1, if ever, and none is removed."""
    rules = variant.geometry.density
    once = replace(
        rules, hidden_at=(PRUNED_AFTER / INITIALISE_STEPS,) if rules.hidden_at else (), least_contribution=0.0
    )
    return replace(variant, geometry=replace(variant.geometry, density=once))


def _in_the_hull(variant: Variant) -> Variant:
    """Surfels start in the visual hull, where there are as many as are asked for; images have points for fewer."""
    start = replace(variant.geometry.start, points="hull")
    return replace(variant, geometry=replace(variant.geometry, start=start))


def _density_kinds(variant: Variant, budget: Budget) -> tuple[StepKind, ...]:
    """Steps of stage 1 with a round of density control, and with a look at all training views.

    A step with both counts as one of each: what they add to a usual step adds up.
    """
    rules = variant.geometry.density
    rounds = frozenset(
        done - 1
        for done in range(DENSIFY_EVERY, INITIALISE_STEPS, DENSIFY_EVERY)
        if rules.start <= done / INITIALISE_STEPS < rules.end
    )
    whole_rounds = int((rules.end - rules.start) * budget.geometry.steps / budget.geometry.densify_interval)
    looks = len({round(share * budget.geometry.steps) for share in rules.hidden_at})
    return (
        StepKind("round of density control", rounds, whole_rounds),
        StepKind("step that looks for hidden surfels", frozenset({PRUNED_AFTER - 1} if looks else ()), looks),
    )


def _kinds(rare: tuple[StepKind, ...], steps: int, short: int) -> tuple[StepKind, ...]:
    """The usual steps of a stage, and the rare ones."""
    usual = frozenset(range(short)).difference(*(kind.steps for kind in rare))
    return StepKind("step", usual, steps - sum(kind.whole for kind in rare)), *(kind for kind in rare if kind.steps)


FLOAT = 4

SURFEL = FLOAT * (3 + 4 + 2 + 1 + 3 * 16 + 3 + 1)
"""Centre, rotation, log-scale, opacity, 16 harmonics of three channels, albedo, roughness."""

LEARNT = 3 * SURFEL
"""A surfel's parameters and Adam's two moments of each."""

SAMPLE = FLOAT * (3 + 3 + 1 + 1)
"""Incident light along a direction: the direction, L_ind, solid angle and V."""

PIXEL = 4
"""Of a training image that is held: three colours and coverage of 8 bits."""

HITS = 6.0
"""Surfels that a ray meets in a trained model, on average (``corner``, preset tiny: 6.1). Those that
fill a visual hull are met by 48; surfels laid on surfaces by 2.3."""


@dataclass(frozen=True)
class Phase:
    """Bytes a surfel, a pixel and a ray that a step takes while it runs, beside what stays."""

    surfel: int = 0
    pixel: int = 0
    ray: int = 0


INITIALISE = Phase(surfel=850, pixel=360)
INVERT = Phase(surfel=1060, pixel=380, ray=95)
REFRESH = Phase(surfel=510, ray=86)
RELIGHT = Phase(surfel=1440, ray=150)
FRAME = Phase(surfel=360, pixel=102)
OWN_FRAME = Phase(surfel=240, pixel=60)
FINE_TUNE = Phase(surfel=1650, ray=90)

HIT = 24
"""Bytes of a hit: surfel, depth and opacity, once in the parts that were found and once joined."""

DRAWN = 8
"""Bytes a direction that is drawn takes beside ``SAMPLE``."""


def memory_of(
    variant: Variant, budget: Budget, surfels: int, images: TrainingImages, hits: float = HITS
) -> tuple[MemoryPhase, ...]:
    """Bytes for each phase of a run whose model has so many surfels, with no effect left out.

    ``hits``: surfels that a ray meets. Starting points are not among the phases: they are drawn on the host, a million
    candidates of 100 bytes at a time. What libraries, compiled kernels and gaps of an allocator take is not counted.
    """
    pixels, traced = images.width * images.height, variant.shading == "monte-carlo"
    samples = budget.incident_samples if traced else 0
    directions = budget.relight_hemisphere_samples + budget.relight_light_samples
    views = PIXEL * images.views * pixels
    learnt = views + filters_bytes(min(budget.light_height, LARGEST_HEIGHT))
    alone = surfels * SURFEL
    model = alone + surfels * 3 * FLOAT
    # Stage 2 also keeps the tree that rays go through and, for probes of effects, the outcome of stage 1.
    probed_from = 0 if variant.effects == "all" else LEARNT
    initialised = learnt + surfels * (LEARNT + 3 * FLOAT)
    inverted = learnt + surfels * (LEARNT + probed_from + 600 + SAMPLE * samples)
    shown = filters_bytes(LARGEST_HEIGHT) + model
    relit = shown + surfels * SAMPLE * directions
    solved = model + SAMPLE * budget.finetune_surfels * budget.finetune_samples

    def peak(held: int, phase: Phase, rays: int = 0) -> int:
        return round(held + phase.surfel * surfels + phase.pixel * pixels + (phase.ray + HIT * hits) * rays)

    def together(rays: int) -> int:
        return min(RAYS_AT_ONCE, rays)

    a_step = peak(inverted, INVERT, min(surfels, budget.consistency_surfels) * samples)
    anew = peak(inverted + surfels * (SAMPLE + DRAWN) * samples, REFRESH, together(surfels * samples))
    prepared = peak(relit, RELIGHT, together(surfels * budget.relight_hemisphere_samples))
    tuned = peak(solved, FINE_TUNE, together(budget.finetune_surfels * budget.finetune_samples))
    return (
        MemoryPhase("stage 1, a step", initialised, peak(initialised, INITIALISE)),
        MemoryPhase("stage 2, a step", inverted, a_step),
        *([MemoryPhase("stage 2, all light anew", inverted, max(a_step, anew))] if traced else []),
        MemoryPhase("relighting, preparing by rays", shown, prepared),
        MemoryPhase("relighting, a frame by rays", relit, peak(relit, FRAME)),
        MemoryPhase("relighting, a step of fine-tuning", model, tuned),
        MemoryPhase("relighting, a frame by surfels alone", alone, peak(alone, OWN_FRAME)),
    )
