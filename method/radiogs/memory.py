"""What a run of RadioGS holds, by formula: bytes of its phases for numbers of surfels, pixels and rays.

What stays between steps follows from the shapes of what is kept. What a step takes beside that is a number of bytes for
each surfel, pixel, ray and hit, found with the CPU's allocator; ``tests/method/radiogs/test_memory.py`` compares the
sums with what is measured. Nothing has an entry for each harmonic of each sample.
"""

from dataclasses import dataclass

from radiogs_core.capabilities import MemoryPhase, TrainingImages
from radiogs_core.transport.light_filters import filters_bytes
from radiogs_core.transport.splitsum import LARGEST_HEIGHT
from radiogs_core.transport.tracer import RAYS_AT_ONCE

from .budget import Budget
from .variant import Variant

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
    # Stage 2 also keeps what stage 1 left, from which probes of effects begin, and the tree that rays go through.
    initialised = learnt + surfels * (LEARNT + 3 * FLOAT)
    inverted = learnt + surfels * (2 * LEARNT + 600 + SAMPLE * samples)
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
