"""The memory of a run by formula agrees with the CPU's allocator."""

from dataclasses import replace

import pytest

from bench.memory import VIEWS, Measured, measured, surfels_over, tables
from radiogs.method import RADIOGS
from radiogs.rehearsing import SAMPLE, SURFEL, memory_of
from radiogs.settings import PRESETS, Variant
from radiogs_core.capabilities import MemoryPhase, PlansMemory, TrainingImages
from radiogs_core.kernels.trace.hits import BUFFER, RAYS_AT_ONCE

GIB = 2**30
CARD = 24 * GIB
TENSOIR = TrainingImages(100, 800, 800)
LEAST, MOST = 0.92, 1.2
"""Bounds on the ratio of computed to measured peaks. Hits differ from ray to ray, and pairs of surfels and tiles depend
on the surfels' sizes."""

SIDE = 96

BUDGET = replace(
    PRESETS["paper"],
    consistency_surfels=2048, incident_samples=32, relight_hemisphere_samples=96, relight_light_samples=32,
    finetune_surfels=2048, finetune_samples=128, light_height=16,
)  # fmt: skip


Sizes = tuple[Measured, dict[str, MemoryPhase]]


@pytest.fixture(scope="module", params=[pytest.param(each, marks=pytest.mark.slow) for each in (0.03, 0.012)])
def sizes(request: pytest.FixtureRequest) -> Sizes:
    found = measured(request.param, BUDGET, SIDE)
    plan = memory_of(Variant(), BUDGET, found.surfels, TrainingImages(VIEWS, SIDE, SIDE), found.hits)
    return found, {phase.title: phase for phase in plan}


def test_memory_between_steps_agrees_with_the_allocator(sizes: Sizes) -> None:
    found, plan = sizes
    assert set(found.phases) == set(plan)
    for title, phase in plan.items():
        kept = found.phases[title].held + tables(title, BUDGET)
        assert phase.held == pytest.approx(kept, rel=0.04), (title, found.surfels)


def test_peaks_agree_with_the_allocator(sizes: Sizes) -> None:
    found, plan = sizes
    for title, phase in plan.items():
        own, counted = phase.peak - tables(title, BUDGET), found.phases[title].peak
        assert LEAST * counted < own < MOST * counted, (title, found.surfels, own, counted)


def test_no_array_is_larger_than_the_cached_samples_or_a_buffer_of_hits(sizes: Sizes) -> None:
    found, _ = sizes
    directions = BUDGET.relight_hemisphere_samples + BUDGET.relight_light_samples
    hits = 4.1 * RAYS_AT_ONCE * BUFFER
    samples = SAMPLE * found.surfels * BUDGET.incident_samples
    assert found.phases["stage 2, all light anew"].largest < max(samples, hits)
    for kind in ("rays", "traced bounces"):
        largest = found.phases[f"relighting, preparing by {kind}"].largest
        assert largest < max(SAMPLE * found.surfels * directions, hits)


def test_the_planned_bytes_of_a_surfel_are_those_of_its_parameters() -> None:
    (one,) = {sum(value[0].nbytes for value in surfels_over(0.1).parameters().values())}
    assert one == SURFEL


def test_preset_paper_with_half_a_million_surfels_fits_a_card_of_24_gb() -> None:
    assert isinstance(RADIOGS, PlansMemory)
    half_a_million = RADIOGS.memory(Variant(), PRESETS["paper"], 500_000, TENSOIR)
    most = max(half_a_million, key=lambda phase: phase.peak)
    assert most.title == "relighting, preparing by traced bounces"
    assert 500_000 * 384 * SAMPLE < most.peak < CARD / 3
    largest = RADIOGS.memory(Variant(), PRESETS["paper"], PRESETS["paper"].geometry.maximum_surfels, TENSOIR)
    assert max(phase.peak for phase in largest) > CARD


def test_split_sum_shading_needs_no_memory_for_rays() -> None:
    traced, not_traced = (
        RADIOGS.memory(replace(Variant(), shading=shading), PRESETS["paper"], 10_000, TENSOIR)
        for shading in ("monte-carlo", "split-sum")
    )
    assert {phase.title for phase in traced} - {phase.title for phase in not_traced} == {"stage 2, all light anew"}
    assert traced[1].held - not_traced[1].held == 10_000 * 2 * 64 * (SAMPLE + 12), (
        "two sets, with what arrives under a held light"
    )
