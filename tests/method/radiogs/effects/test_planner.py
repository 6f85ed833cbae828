"""Probes during training: their scene, their decisions, and the failure of a probe."""

import copy
import dataclasses
from typing import Any

import pytest
import torch

from probed_scenes import CLAY, FLOOR, SAMPLES, hidden, seen, sheet, sky, step
from radiogs.effects.planner import Planner
from radiogs.effects.probe import Occasion
from radiogs.effects.probe_scene import SHARP_ROUGHNESS, KeptLight, ProbeScene
from radiogs.effects.staleness import decide_refresh
from radiogs.effects.step_cost import Step
from radiogs.effects.tolerance import Tolerance
from radiogs.invert import InverseRendering
from radiogs.method import inverse_rendering
from radiogs.rays import RaySettings
from radiogs.settings import Variant
from radiogs_core.contract import Run
from radiogs_core.instruments import recording
from radiogs_core.learning.views import TrainingView, Whole
from radiogs_core.scene.scene import View
from radiogs_core.transport.incident import unoccluded
from radiogs_core.transport.plan import EffectPlan
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_core.transport.tracer import SurfelTracer, incident_along
from radiogs_datasets.generate.solids import Box, Sphere
from scenes import surfels_over
from short_training import BUDGET, CPU, SCENE


def test_a_probe_during_training_assesses_the_lobe_at_a_low_roughness() -> None:
    ball = surfels_over([Sphere((0.0, 0.0, 0.0), 0.8, CLAY)], 0.25)
    assert (
        Planner("auto", 0, 40, SAMPLES, RaySettings(), straight=True).scene(ball, sky(), (), 0).sharpest
        == SHARP_ROUGHNESS
    )


def test_the_work_of_a_step_follows_from_its_size() -> None:
    """Each step draws 20 of 100 surfels, with 8 samples each; all are traced again every 10 steps.

    All surfels are shaded once, and the drawn ones twice more, for both directions of L_rad; a ray blends four surfels.
    """
    work = Step(100, 20, 8, 10).work(EffectPlan())
    rays = 8 * (20 + 100 / 10)
    assert work == {
        "rays": rays, "shaded_samples": 140 * 8, "lobes": 140 * 8, "coefficients": (140 + 4 * rays) * 16,
        "surfels": 100,
    }  # fmt: skip
    assert Step(10, 20, 8, 10).work(EffectPlan())["rays"] == 8 * (10 + 1)


def planned(initialised: dict[str, Any]) -> InverseRendering:
    return inverse_rendering(Run(SCENE, Variant(effects="auto"), BUDGET, 0, CPU), initialised)


def test_a_failed_probe_turns_all_effects_on(initialised: dict[str, Any]) -> None:
    stage = planned(initialised)
    stage.planner.plan = EffectPlan().without("indirect").without("visibility")
    stage.initialised = copy.deepcopy(stage.initialised)
    stage.initialised["surfels"]["sh"][:] = torch.nan
    stage.step()
    assert stage.planner.plan == EffectPlan()
    assert "failed" in stage.planner.evidence[-1].why


def views_of(made: ProbeScene) -> list[TrainingView]:
    """Training views for a planner, which show the targets of a probe's views."""
    shown = [(view.camera, view.target) for view in made.views if view.target is not None]
    return [
        TrainingView(camera, View("", camera, {}), Whole(target), Whole(torch.ones_like(target[..., 0])))
        for camera, target in shown
    ]


def without_rays() -> Planner:
    """A planner that has left out all rays."""
    planner = Planner("auto", 0, 30, SAMPLES, RaySettings(), straight=True)
    planner.plan = dataclasses.replace(EffectPlan().without("indirect").without("visibility"), kept=True)
    return planner


WALL = Box((-0.7, -0.02, 0.002), (0.7, 0.02, 0.6), CLAY)


def test_an_effect_that_appears_during_training_is_switched_on_again() -> None:
    """A plan without rays was decided before a wall appeared."""
    planner = without_rays()
    surfels = surfels_over([FLOOR, WALL], 0.12)
    assert planner.due(15)
    changed = planner.observe(surfels, sky(), views_of(seen(surfels, sky())), step(surfels), 15)
    assert changed
    assert planner.plan.visibility


@pytest.mark.parametrize("moved", [False, True])
def test_light_is_kept_as_long_as_rays_trace_the_same_light(moved: bool) -> None:
    """Kept light from before a wall appeared is dropped; kept light that contains the wall is as good as rays."""
    planner = without_rays()
    surfels = surfels_over([FLOOR, WALL], 0.12)
    made = seen(surfels, sky())
    direction, weight = hemisphere_directions(surfels.frame[..., 2], planner.samples, torch.Generator().manual_seed(3))
    anew = incident_along(SurfelTracer(surfels), direction, weight)
    light = unoccluded(direction, weight) if moved else anew
    kept = KeptLight(torch.ones(len(surfels), dtype=torch.bool), light, anew)
    changed = planner.observe(surfels, sky(), views_of(made), step(surfels), 15, kept=kept)
    assert changed == moved
    assert planner.plan.traces == moved
    assert planner.plan.kept or moved


def test_a_probe_does_not_trace_surfels_with_kept_light() -> None:
    surfels = surfels_over([FLOOR, WALL], 0.12)
    made = seen(surfels, sky())
    direction, weight = hemisphere_directions(surfels.frame[..., 2], SAMPLES // 2, None)
    mask = torch.arange(len(surfels)) % 3 == 0
    lit = unoccluded(direction[mask], weight[mask])
    kept = KeptLight(mask, lit, dataclasses.replace(lit, visibility=0.5 * lit.visibility))
    with recording() as instruments:
        found = Planner("auto", 0, 30, SAMPLES, RaySettings(), straight=True).scene(
            surfels, sky(), views_of(made), 5, kept
        )
    assert instruments.work["rays"] == int((~mask).sum()) * SAMPLES // 2
    assert torch.equal(found.incident.direction[mask], direction[mask])
    assert (found.incident.visibility[mask] == 0.5).all()
    assert (found.untraced.visibility[mask] == 1).all()
    assert found.incident.radiance[~mask].any()


def test_a_fresh_cache_is_refreshed_less_often_and_a_stale_one_more_often() -> None:
    tolerance, budgeted = Tolerance(1e-3), Step(2500, 64, 32, 20)
    still = 1e-9 * torch.rand(200)
    factor, record = decide_refresh(still, tolerance, budgeted, Occasion(0, 10), 1e-3)
    assert (factor, record.verdict) == (2, "off")
    moving = 1e-2 * torch.rand(200)
    factor, record = decide_refresh(moving, tolerance, budgeted, Occasion(0, 20, EffectPlan(refresh=2)), 1e-3)
    assert (factor, record.verdict) == (1, "on")


@pytest.mark.slow
@pytest.mark.parametrize("released", [False, True])
def test_probes_during_training_encode_images_and_trace_rays_as_the_variant_does(
    initialised: dict[str, Any], released: bool
) -> None:
    """The back of the sheet occludes the sky for the floor; rays of the released code pass through it."""
    deviations = ("hemisphere-floor", "one-sided-rays", "premultiplied-encoding") if released else ()
    variant = Variant(effects="auto", deviations=deviations)
    stage = inverse_rendering(Run(SCENE, variant, BUDGET, 0, CPU), initialised)
    made = stage.planner.scene(sheet(), sky(), stage.views, 0)
    assert made.straight != released
    assert bool((hidden(made) < 0.01).all() if released else (hidden(made) > 0.25).all())
    cosine = (made.incident.direction * made.surfels.frame[:, None, :, 2]).sum(-1)
    assert (float(cosine.min()) > 0.17) == released
