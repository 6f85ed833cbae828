"""Probes during training: when they pay, their scene, their decisions, and the failure of a probe."""

import copy
import dataclasses
from typing import Any

import pytest
import torch

from probed_scenes import CLAY, FLOOR, SAMPLES, hidden, seen, sheet, sky
from radiogs.effects.plans import LEAST_SAVED, Step, why_not_probed
from radiogs.effects.probe_scene import ProbeScene
from radiogs.effects.training import BEFORE, Planner
from radiogs.incident_cache import IncidentCache
from radiogs.invert import InverseRendering
from radiogs.kept_light import KeptLight
from radiogs.method import inverse_rendering
from radiogs.model import Model
from radiogs.rays import RaySettings
from radiogs.settings import PRESETS, Budget, Variant
from radiogs_core.contract import Run
from radiogs_core.instruments import recording
from radiogs_core.learning.views import TrainingView
from radiogs_core.plain_values import with_values
from radiogs_core.scene.scene import View
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.plan import EffectPlan
from radiogs_core.transport.tracer import SurfelTracer
from radiogs_datasets.generate.solids import Box
from scenes import surfels_over
from short_training import BUDGET, CPU, PROBED, SCENE

AUTO = Variant(effects="auto")


def test_the_work_of_a_step_follows_from_its_size() -> None:
    """Each step draws 20 of 100 surfels, with 8 samples each; all are traced again every 10 steps.

    All surfels are shaded once, and the drawn ones twice more, for both directions of L_rad; a ray blends four surfels.
    """
    rays = 8 * (20 + 100 / 10)
    assert Step(100, 20, 8, 10, pixels=50).work(EffectPlan()) == {
        "rays": rays, "directions": rays, "compared": 8 * 20, "shaded_samples": 800, "lobes": 800,
        "coefficients": (140 + 4 * rays) * 16, "surfels": 100, "pixels": 50,
    }  # fmt: skip
    assert Step(10, 20, 8, 10).work(EffectPlan())["rays"] == 8 * (10 + 1)
    without = Step(100, 20, 8, 10).work(EffectPlan().without("indirect").without("visibility"))
    assert (without["rays"], without["directions"]) == (0, 8 * 10)


def why_not(budget: Budget, surfels: int, pixels: int = 96**2, **changes: Any) -> str:
    variant = dataclasses.replace(AUTO, **changes)
    return why_not_probed(variant, budget, Step.of(variant, budget, surfels, pixels), 2) or ""


def test_probes_pay_from_preset_small_on() -> None:
    """With the surfels that training of ``convex`` ends stage 1 with, and its views."""
    sizes = {"smoke": 400, "tiny": 5_900, "small": 18_700, "paper": 100_000}
    pays = {name: not why_not(PRESETS[name], surfels) for name, surfels in sizes.items()}
    assert pays == {"smoke": False, "tiny": False, "small": True, "paper": True}


def test_whether_probes_pay_follows_from_settings_and_not_from_names() -> None:
    small = PRESETS["small"]
    assert not why_not(with_values(PRESETS["tiny"], {"inverse_iterations": 3000, "incident_samples": 128}), 5_900)
    assert f"from {100 * LEAST_SAVED:.0f} % on" in why_not(with_values(small, {"incident_samples": 8}), 18_700)
    assert "less work" in why_not(with_values(small, {"geometry.steps": 100_000}), 18_700)
    assert "less work" in why_not(small, 18_700, pixels=4_000_000)
    assert "less work" in why_not(small, 18_700, incident="precomputed")
    short = with_values(small, {"geometry.steps": 100, "inverse_iterations": 300})
    assert "probes would take" in why_not(short, 18_700)


def planned(initialised: dict[str, Any], budget: Budget = PROBED) -> InverseRendering:
    return inverse_rendering(Run(SCENE, AUTO, budget, 0, CPU), initialised)


def test_where_probes_do_not_pay_auto_is_all_and_says_so(initialised: dict[str, Any]) -> None:
    auto, full = planned(initialised, BUDGET), inverse_rendering(Run(SCENE, Variant(), BUDGET, 0, CPU), initialised)
    for _ in range(12):
        auto.step()
        full.step()
    assert all(torch.equal(value, full.optimiser.tensors[name]) for name, value in auto.optimiser.tensors.items())
    (record,) = auto.model.evidence
    assert (record["verdict"], record["measured"]) == ("on", None)
    assert "no probe" in record["why"]
    assert auto.model.plan == EffectPlan()


def test_a_ball_that_needs_no_rays_is_trained_with_hardly_any(initialised: dict[str, Any]) -> None:
    """The rays of the whole training are extrapolated from its first steps."""
    planned_rays = {}
    for effects in ("all", "auto"):
        stage = inverse_rendering(Run(SCENE, Variant(effects=effects), PROBED, 0, CPU), initialised)
        with recording() as first:
            stage.step()
        with recording() as more:
            for _ in range(20):
                stage.step()
        planned_rays[effects] = first.work["rays"] + more.work["rays"] / 20 * PROBED.inverse_iterations
    assert not stage.plan.traces
    assert stage.planning.at == {0, PROBED.inverse_iterations // 2}
    assert not more.work["node_visits"]
    assert planned_rays["auto"] < 0.01 * planned_rays["all"]


def test_a_failed_probe_turns_all_effects_on(initialised: dict[str, Any]) -> None:
    stage = planned(initialised)
    stage.planning.initialised = copy.deepcopy(stage.planning.initialised)
    stage.planning.initialised["surfels"]["sh"][:] = torch.nan
    with recording() as instruments:
        stage.step()
    assert stage.plan == stage.cache.plan == EffectPlan()
    assert "failed" in stage.planning.evidence[-1].why
    assert instruments.work["rays"] > stage.cache.incident.weight.numel()


def views_of(made: ProbeScene) -> list[TrainingView]:
    """Training views for a planner, which show the targets of a probe's views."""
    shown = [(view.camera, view.target) for view in made.views if view.target is not None]
    return [
        TrainingView(camera, View("", camera, {}), target, torch.ones_like(target[..., 0])) for camera, target in shown
    ]


def without_rays(surfels: Surfels) -> Planner:
    """A planner that has left out all rays."""
    planner = Planner(Run(SCENE, AUTO, PROBED, 0, CPU), {"surfels": surfels.parameters(), "initialised": {}})
    planner.plan = dataclasses.replace(EffectPlan().without("indirect").without("visibility"), kept=True)
    return planner


WALL = Box((-0.7, -0.02, 0.002), (0.7, 0.02, 0.6), CLAY)


def model_of(surfels: Surfels) -> Model:
    return Model(surfels, sky().log())


def cache_of(surfels: Surfels, kept: KeptLight) -> IncidentCache:
    """A cache of surfels that keep this light."""
    cache = IncidentCache(model_of(surfels), RaySettings(), AUTO, PROBED, torch.Generator(), BEFORE)
    cache.kept = kept
    return cache


@pytest.mark.parametrize("moved", [False, True])
def test_light_is_kept_as_long_as_rays_trace_the_same_light(moved: bool) -> None:
    """Kept light from before a wall appeared is dropped; kept light that contains the wall is as good as rays."""
    surfels = surfels_over([FLOOR, WALL], 0.12)
    planner, tracer = without_rays(surfels), SurfelTracer(surfels)
    kept = KeptLight.traced(tracer)
    if moved:
        kept = dataclasses.replace(kept, visibility=torch.ones_like(kept.visibility), radiance=0 * kept.radiance)
    planner.observe(model_of(surfels), views_of(seen(surfels, sky())), 10_000, cache_of(surfels, kept))
    assert planner.plan.traces == moved
    assert planner.plan.kept or moved


def test_a_probe_of_kept_light_traces_some_of_its_cells_again() -> None:
    """It traces as training does, and compares this light with the kept light along the same directions."""
    surfels = surfels_over([FLOOR, WALL], 0.12)
    planner, tracer = without_rays(surfels), SurfelTracer(surfels)
    kept = KeptLight.traced(tracer)
    cache = cache_of(surfels, dataclasses.replace(kept, visibility=0.5 + 0 * kept.visibility))
    views = views_of(seen(surfels, sky()))
    with recording() as instruments:
        found = planner.scene(model_of(surfels), views, 5, cache)
    assert instruments.work["rays"] == len(surfels) * SAMPLES // 2
    now = tracer.incident(torch.arange(len(surfels)), found.incident.direction, found.incident.weight)
    assert torch.equal(found.incident.visibility, now.visibility)
    assert torch.equal(found.untraced.direction, found.incident.direction)
    assert (found.untraced.visibility == 0.5).all()
    assert found.incident.radiance.any()


@pytest.mark.slow
@pytest.mark.parametrize("released", [False, True])
def test_probes_during_training_encode_images_and_trace_rays_as_the_variant_does(
    initialised: dict[str, Any], released: bool
) -> None:
    """The back of the sheet occludes the sky for the floor; rays of the released code pass through it."""
    deviations = ("hemisphere-floor", "one-sided-rays", "premultiplied-encoding") if released else ()
    variant = Variant(effects="auto", deviations=deviations)
    stage = inverse_rendering(Run(SCENE, variant, PROBED, 0, CPU), initialised)
    made = stage.planning.scene(model_of(sheet()), stage.views, 0, stage.cache)
    assert made.straight != released
    assert bool((hidden(made) < 0.01).all() if released else (hidden(made) > 0.25).all())
    cosine = (made.incident.direction * made.surfels.frame[:, None, :, 2]).sum(-1)
    assert (float(cosine.min()) > 0.17) == released
