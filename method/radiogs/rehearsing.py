"""Time and memory of a long run: a short run with a few steps of every kind at full size, and a formula for memory.

The short run is for a rehearsal (``radiogs_core.capabilities.Rehearsing``). The formula gives the bytes of the phases
of a run by numbers of surfels, pixels and rays. Memory between steps follows from the shapes of the stored tensors; the
additional memory of a step is a number of bytes for each surfel, pixel, ray and hit, measured with the CPU's allocator.
``tests/method/radiogs/test_memory.py`` compares the sums with measurements. No tensor has an entry for each harmonic of
each sample.
"""

from dataclasses import dataclass, replace

from radiogs_core.capabilities import MemoryPhase, Relighting, ShortRun, StepKind, TrainingImages
from radiogs_core.kernels.trace.hits import BUFFER
from radiogs_core.kernels.trace.hits import RAYS_AT_ONCE as CHUNK
from radiogs_core.learning.views import PREPARED_BYTES
from radiogs_core.plain_values import with_values
from radiogs_core.transport.interreflection import KEPT_BYTES
from radiogs_core.transport.light_filters import filters_bytes
from radiogs_core.transport.splitsum import LARGEST_HEIGHT
from radiogs_core.transport.tracer import RAYS_AT_ONCE

from .settings import RELIGHTING, Budget, Variant

INITIALISE_STEPS = 12
"""Steps of the short stage 1. Schedules depend on the share of steps done, so that all harmonics and losses occur."""

DENSIFY_EVERY = 3
"""Steps between two rounds of density control in the short stage 1."""

PRUNED_AFTER = 11
"""Steps of the short stage 1 before the search for hidden surfels; no round of density control is due then."""

INVERT_STEPS = 6
"""Steps of the short stage 2."""

REFRESH_EVERY = 4
"""Steps of the short stage 2 between two tracings of all light."""

FINETUNE_STEPS = 3
"""Steps of the short fine-tuning: the first, which is not counted, and two that are."""

TITLES = {
    "pbr": "by rays, split sum",
    "finetuned": "by rays, fine-tuned",
    "surfels": "by surfels alone, fine-tuned",
}
"""Titles of modes of relighting by which stored measurements are compared; other modes have the method's title."""


def sizes(budget: Budget) -> tuple[int, int]:
    """Initial and largest number of surfels of a run."""
    geometry = budget.geometry
    return min(geometry.initial_surfels, geometry.maximum_surfels), geometry.maximum_surfels


def short_run(variant: Variant, budget: Budget, size: int) -> ShortRun:
    """A run of a few steps that begins with ``size`` surfels and never has more.

    The surfels start in the visual hull, whichever start the variant names; the surfels of a trained model lie on
    surfaces instead. The search for hidden surfels runs once but removes none: most surfels in a hull are hidden, and
    the model has to keep its size.
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
    rehearsed = _in_the_hull(_pruning_once(variant))
    ways = tuple(
        Relighting(
            TITLES.get(mode, f"by {title}"),
            with_values(rehearsed, {RELIGHTING.field: mode}),
            budget.finetune_iterations if mode in RELIGHTING.by_steps else 0,
        )
        for mode, title in RELIGHTING.titles.items()
        if mode != RELIGHTING.reference
    )
    return ShortRun(rehearsed, short, kinds, ways)


def _pruning_once(variant: Variant) -> Variant:
    """The variant that searches for hidden surfels once in the short stage 1, if at all, and removes none."""
    rules = variant.geometry.density
    once = replace(
        rules, hidden_at=(PRUNED_AFTER / INITIALISE_STEPS,) if rules.hidden_at else (), least_contribution=0.0
    )
    return replace(variant, geometry=replace(variant.geometry, density=once))


def _in_the_hull(variant: Variant) -> Variant:
    """The variant whose surfels start in the visual hull, which has enough points for any number of them."""
    start = replace(variant.geometry.start, points="hull")
    return replace(variant, geometry=replace(variant.geometry, start=start))


def _density_kinds(variant: Variant, budget: Budget) -> tuple[StepKind, ...]:
    """Steps of stage 1 with a round of density control, and with the search for hidden surfels in all views.

    A step with both counts as one of each, because their additional times add up.
    """
    rules = variant.geometry.density
    rounds = frozenset(
        done - 1
        for done in range(DENSIFY_EVERY, INITIALISE_STEPS, DENSIFY_EVERY)
        if rules.start <= done / INITIALISE_STEPS < rules.end
    )
    whole_rounds = int((rules.end - rules.start) * budget.geometry.steps / budget.geometry.densify_interval)
    searches = len({round(share * budget.geometry.steps) for share in rules.hidden_at})
    return (
        StepKind("round of density control", rounds, whole_rounds),
        StepKind("step that looks for hidden surfels", frozenset({PRUNED_AFTER - 1} if searches else ()), searches),
    )


def _kinds(rare: tuple[StepKind, ...], steps: int, short: int) -> tuple[StepKind, ...]:
    """The usual steps of a stage, and the kinds of ``rare`` ones that occur."""
    usual = frozenset(range(short)).difference(*(kind.steps for kind in rare))
    return StepKind("step", usual, steps - sum(kind.whole for kind in rare)), *(kind for kind in rare if kind.steps)


FLOAT = 4
"""Bytes of a float32."""

SURFEL = FLOAT * (3 + 4 + 2 + 1 + 3 * 16 + 3 + 1)
"""Bytes of a surfel: centre, rotation, log-scale, opacity, 16 harmonics of three channels, albedo, roughness."""

LEARNT = 3 * SURFEL
"""Bytes of a learnt surfel: its parameters, and Adam's two moments of each."""

SAMPLE = FLOAT * (3 + 3 + 1 + 1)
"""Bytes of the incident light along a direction: the direction, L_ind, solid angle and V."""

PIXEL = 4
"""Bytes of a pixel of a loaded training image: three colours and coverage, 8 bits each."""

HITS = 6.0
"""Average number of surfels that a ray hits in a trained model (``corner``, preset tiny: 6.1). A ray hits 48 in a
filled visual hull, and 2.3 if the surfels lie on the true surfaces."""


@dataclass(frozen=True)
class Phase:
    """Additional bytes that a step allocates while it runs."""

    surfel: int = 0
    """Bytes for each surfel."""
    pixel: int = 0
    """Bytes for each pixel."""
    ray: int = 0
    """Bytes for each ray."""


INITIALISE = Phase(surfel=500, pixel=330)
"""A step of stage 1."""

INVERT = Phase(surfel=1060, pixel=380, ray=95)
"""A step of stage 2."""

REFRESH = Phase(surfel=510, ray=60)
"""A tracing of the light on all surfels in stage 2."""

RELIGHT = Phase(surfel=1440, ray=150)
"""The preparation of relighting by rays."""

BOUNCE = Phase(surfel=400, ray=10)
"""The preparation of relighting by traced bounces."""

FRAME = Phase(surfel=360, pixel=102)
"""A frame of a model that is relit by rays."""

OWN_FRAME = Phase(surfel=120, pixel=55)
"""A frame of the surfels' own radiance."""

FINE_TUNE = Phase(surfel=1650, ray=45)
"""A step of fine-tuning."""

KEPT_RAY, KEPT_HIT = 12, 12
"""Bytes of a ray, and of each of its hits, that are kept between bounces (``transport.interreflection``)."""

HIT = 24
"""Bytes of a hit: surfel, depth and opacity, once in the rounds of tracing and once concatenated."""

BUFFERED = 12 * BUFFER
"""Bytes of the buffer of a ray's hits, which is there while no image is blended."""

PREPARED_PIXEL = 52
"""Bytes of what steps compute of a pixel of a training image and keep (``learning.views.PREPARED_BYTES``)."""

DRAWN = 8
"""Bytes of a direction while it is drawn, in addition to ``SAMPLE``."""


def memory_of(
    variant: Variant, budget: Budget, surfels: int, images: TrainingImages, hits: float = HITS
) -> tuple[MemoryPhase, ...]:
    """Bytes of each phase of a run whose model has this number of ``surfels``, with all effects on.

    ``hits``: average number of surfels that a ray hits. Initial points are not among the phases: they are drawn on the
    host, a million candidates of 100 bytes at a time. The memory of libraries and compiled kernels, and the gaps of an
    allocator, are not counted.
    """
    pixels, traced = images.width * images.height, variant.shading == "monte-carlo"
    samples = budget.incident_samples if traced else 0
    directions = budget.relight_hemisphere_samples + budget.relight_light_samples
    views = PIXEL * images.views * pixels
    learnt = views + 2 * filters_bytes(min(budget.light_height, LARGEST_HEIGHT))  # those of gradients, too
    prepared = min(PREPARED_BYTES, PREPARED_PIXEL * images.views * pixels)
    alone = surfels * SURFEL
    model = alone + surfels * 3 * FLOAT
    # Stage 2 also keeps the tree of the ray tracer and, for probes of effects, the model of stage 1.
    probed = SURFEL if variant.effects == "auto" else 0
    initialised = learnt + prepared + surfels * (LEARNT + 3 * FLOAT)
    arriving = 3 * FLOAT if variant.materials.rates.light == 0 else 0
    cached = variant.materials.directions.sets * samples
    inverted = learnt + prepared + surfels * (LEARNT + probed + 790 + (SAMPLE + arriving) * cached)
    filtered = filters_bytes(LARGEST_HEIGHT) + alone
    relit = filtered + model - alone + surfels * SAMPLE * directions
    finetuning = model + SAMPLE * budget.finetune_surfels * budget.finetune_samples

    def peak(held: int, phase: Phase, rays: int = 0) -> int:
        shown = phase.surfel * surfels + phase.pixel * pixels
        return round(held + max(shown, BUFFERED * min(CHUNK, rays)) + (phase.ray + HIT * hits) * rays)

    def together(rays: int) -> int:
        return min(RAYS_AT_ONCE, rays)

    a_step = peak(inverted, INVERT, min(surfels, budget.consistency_surfels) * samples)
    anew = peak(inverted + surfels * (SAMPLE + DRAWN) * cached, REFRESH, together(surfels * cached))
    prepared = peak(relit, RELIGHT, together(surfels * budget.relight_hemisphere_samples))
    held = alone + surfels * SAMPLE * directions
    kept = min(KEPT_BYTES, round(surfels * directions * (KEPT_RAY + KEPT_HIT * hits)))
    bounced = peak(held + kept, BOUNCE, together(surfels * directions))
    tuned = peak(finetuning, FINE_TUNE, together(budget.finetune_surfels * budget.finetune_samples))
    return (
        MemoryPhase("stage 1, a step", initialised, peak(initialised, INITIALISE)),
        MemoryPhase("stage 2, a step", inverted, a_step),
        *([MemoryPhase("stage 2, all light anew", inverted, max(a_step, anew))] if traced else []),
        MemoryPhase("relighting, preparing by rays", filtered, prepared),
        MemoryPhase("relighting, preparing by traced bounces", alone, bounced),
        MemoryPhase("relighting, a frame by rays", relit, peak(relit, FRAME)),
        MemoryPhase("relighting, a step of fine-tuning", model, tuned),
        MemoryPhase("relighting, a frame by surfels alone", alone, peak(alone, OWN_FRAME)),
    )
