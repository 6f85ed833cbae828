"""No array of a run has an entry for each harmonic of each sample: they would not fit a card at the paper's sizes."""

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch.profiler import ProfilerActivity, profile

from radiogs.initialise import Initialisation
from radiogs.method import inverse_rendering
from radiogs.model import Model
from radiogs.rehearsing import REFRESH_EVERY, short_run
from radiogs.relighting import relight
from radiogs.settings import PRESETS, Variant
from radiogs_core.contract import Run
from radiogs_core.kernels.runtime import use_threads
from radiogs_core.kernels.trace.hits import BUFFER, RAYS_AT_ONCE
from radiogs_core.surfels.known_surfaces import surfels_on
from radiogs_core.surfels.surfels import Surfels
from radiogs_datasets.enlargement import enlarged
from radiogs_datasets.registry import load_scene

SAMPLE = 4 * (3 + 3 + 1 + 1)
"""Bytes of the incident light along a direction: the direction, L_ind, solid angle and V."""

HITS = 4.1 * RAYS_AT_ONCE * BUFFER
"""Bytes of one array of a buffer of hits, with what the allocator adds."""

BUDGET = replace(
    PRESETS["paper"],
    consistency_surfels=2048, incident_samples=32, relight_hemisphere_samples=96, relight_light_samples=32,
    finetune_surfels=2048, finetune_samples=128, light_height=16,
)  # fmt: skip


def largest_allocation(do: Callable[[], object]) -> int:
    """Bytes of the largest piece of memory that PyTorch's allocator of the CPU hands out."""
    with profile(activities=[ProfilerActivity.CPU], profile_memory=True) as profiled:
        do()
    events = profiled.profiler.kineto_results.events()  # type: ignore[union-attr]
    return max(event.nbytes() for event in events if event.name() == "[memory]")


@pytest.mark.slow
@pytest.mark.parametrize("spacing", [0.03, 0.012])
def test_no_array_is_larger_than_the_cached_samples_or_a_buffer_of_hits(spacing: float) -> None:
    use_threads(1)
    scene = enlarged(load_scene("corner"), 4, 1, 96, 96)
    true = surfels_on(scene.true_surfaces(spacing * scene.extent)).parameters()
    surfels = Surfels.of({name: value.float() for name, value in true.items()})
    short = short_run(Variant(), BUDGET, len(surfels))
    run = Run(scene, short.variant, short.budget, 0, torch.device("cpu"), None)
    stage = Initialisation(run)
    stage.optimiser.replace(surfels, torch.full((len(surfels),), -1))
    inverse = inverse_rendering(run, stage.state())
    while inverse.iteration < REFRESH_EVERY:
        inverse.step()
    samples = SAMPLE * len(surfels) * BUDGET.incident_samples
    assert largest_allocation(inverse.step) < max(samples, HITS), "all light is traced anew"
    model, light = Model.of(inverse.product()), next(iter(scene.lights.values()))
    directions = SAMPLE * len(surfels) * (BUDGET.relight_hemisphere_samples + BUDGET.relight_light_samples)
    for mode in ("pbr", "bounces"):
        way = replace(run, variant=replace(short.variant, relighting=mode))
        largest = largest_allocation(lambda way=way: relight(model, light, torch.ones(3), way))  # type: ignore[misc]
        assert largest < max(directions, HITS), mode
