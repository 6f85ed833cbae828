"""Probes of their own surfaces find the effects that the generated scenes need."""

import functools
import json
import math
from collections.abc import Callable

import pytest
import torch

from radiogs.effects.decision import Evidence
from radiogs.effects.new_light import decide_light_sampling
from radiogs.effects.probe import Findings
from radiogs.effects.probe_scene import ProbeScene
from radiogs.effects.probing import (
    EFFECTS,
    Decay,
    bounces_needed,
    probe_run,
    probe_scene,
    relighting_findings,
    scatter,
    training_findings,
    true_model,
)
from radiogs.settings import PRESETS, Variant
from radiogs_core.contract import Run
from radiogs_core.learning.views import load
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_datasets import load_scene, scene_kind, scene_names
from scenes import sun_and_sky, surfels_of_room


def run(name: str, seed: int) -> Run:
    return Run(load_scene(name), Variant(), PRESETS["tiny"], seed, torch.device("cpu"))


@functools.cache
def found_on(name: str, seed: int) -> tuple[ProbeScene, Findings, Decay]:
    """Scene, findings and decay of light of a probe of the true scene."""
    scene, decay = probe_scene(run(name, seed))
    return scene, training_findings(scene, run(name, seed)), decay


def records(found: Findings) -> dict[str, Evidence]:
    return {record.effect: record for record in found.evidence}


def light_sampling(scene: ProbeScene, light: EnvironmentMap, found: Findings) -> str:
    """Verdict about the directions of preset tiny that are drawn from the light."""
    budget = PRESETS["tiny"]
    directions = budget.relight_hemisphere_samples, budget.relight_light_samples
    return decide_light_sampling(scene.surfels, light, found.tolerance, *directions, 0).verdict


SEEDS = [0, pytest.param(1, marks=pytest.mark.slow)]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(
    ("name", "traces", "inter_reflects"),
    [
        ("convex", False, False),
        ("patchwork", False, False),
        ("occluder", True, False),
        ("wire", True, True),
        ("corner", True, True),
        ("bowl", True, True),
        ("glossy", True, True),
        *(
            pytest.param(name, True, True, marks=pytest.mark.slow)
            for name in ("red_white", "mirror", "niche", "knot", "print")
        ),
    ],
)
def test_scenes_with_occluders_need_rays(name: str, traces: bool, inter_reflects: bool, seed: int) -> None:
    _, found, _ = found_on(name, seed)
    each = records(found)
    assert found.plan.traces == traces
    indirect = each["indirect"].measured
    if inter_reflects:
        assert each["indirect"].verdict == "on"
        assert indirect.contribution > found.tolerance.decibel
    else:
        # Off, or small: at most a tenth of the contribution of the shadow, if there is one.
        shadow = each["visibility"].measured
        assert indirect.contribution <= max(0.1 * shadow.contribution, found.tolerance.decibel)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_white_basin_needs_more_than_one_bounce_and_a_ball_alone_does_not(seed: int) -> None:
    _, found, decay = found_on("bowl", seed)
    several = records(found)["bounces"].measured
    assert several.lowest > found.tolerance.decibel
    assert decay.ratio > 0.3
    assert bounces_needed(found, decay) > 2
    _, found, decay = found_on("convex", seed)
    assert bounces_needed(found, decay) == 1


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", ["niche", "knot"])
def test_patterned_walls_around_an_object_need_more_than_one_bounce(name: str, seed: int) -> None:
    _, found, decay = found_on(name, seed)
    several = records(found)["bounces"].measured
    assert several.lowest > found.tolerance.decibel
    assert bounces_needed(found, decay) > 1


@pytest.mark.parametrize("seed", SEEDS)
def test_smooth_patches_among_matte_ones_keep_the_lobes(seed: int) -> None:
    _, found, _ = found_on("patchwork", seed)
    assert records(found)["specular"].verdict == "on"
    assert found.plan.specular


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("name", "smoothest"), [("convex", 0.5), ("glossy", 0.25), ("mirror", 0.1)])
def test_balls_with_visible_highlights_keep_their_lobes(name: str, smoothest: float, seed: int) -> None:
    scene, found, _ = found_on(name, seed)
    ball = (scene.surfels.roughness - smoothest).abs() < 0.01
    assert bool(ball.any())
    assert found.plan.specular


def even() -> torch.Tensor:
    return torch.full((32, 64, 3), 0.5)


def one_texel() -> torch.Tensor:
    spot = torch.full((32, 64, 3), 0.1)
    spot[9, 20] = 3000.0
    return spot


def real_sun() -> torch.Tensor:
    return sun_and_sky(512)[0]


LIGHTS = ((even, "off"), (one_texel, "on"), (real_sun, "on"))
"""Lights with the expected verdict about light sampling. On ``mirror`` the lobe of a smooth ball gains a little from
any additional directions, also with an even light."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "light", "verdict"),
    [
        (name, *each)
        for name in scene_names()
        for each in LIGHTS
        if scene_kind(name) == "single effects" and (name, each[1]) != ("mirror", "off")
    ],
)
def test_directions_are_drawn_from_a_sun_but_not_from_an_even_light(
    name: str, light: Callable[[], torch.Tensor], verdict: str
) -> None:
    scene, found, _ = found_on(name, 0)
    assert light_sampling(scene, EnvironmentMap(light()), found) == verdict


@pytest.mark.slow
@pytest.mark.parametrize(("name", "verdict"), [("convex", "on"), ("occluder", "off")])
def test_directions_are_drawn_from_the_wide_suns_of_generated_skies_where_it_matters(name: str, verdict: str) -> None:
    scene, found, _ = found_on(name, 0)
    assert light_sampling(scene, EnvironmentMap(scene.environment), found) == verdict


def test_light_in_a_closed_room_decays_by_the_albedo() -> None:
    """If all walls send equal light, equal light arrives everywhere, and each bounce multiplies it by the albedo."""
    walls = surfels_of_room(1.0, 0.2, 0.6)
    direction, weight = hemisphere_directions(walls.frame[..., 2], 32, torch.Generator().manual_seed(0))
    total, decay = scatter(walls, torch.ones_like(walls.albedo), direction, weight, 4)
    for bounce, energy in enumerate(decay.energy, start=1):
        assert energy == pytest.approx(0.6**bounce, rel=0.03 * bounce)
    assert float(total.mean()) == pytest.approx(sum(0.6**bounce for bounce in range(5)), rel=0.05)
    assert decay.ratio == pytest.approx(0.6, rel=0.03)


def test_the_number_of_bounces_follows_from_the_decay() -> None:
    """Errors fall by the square of the ratio: 0.5 after one bounce is 2e-3 after four more."""
    decay = Decay((1.0, 0.5, 0.25))
    assert decay.needed(0.5, 1.0) == 1
    assert decay.needed(0.5, 2e-3) == 1 + 4
    assert Decay((0.0, 0.0)).needed(1.0, 0.1) == 1


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_relighting_by_a_sun_of_half_a_degree_keeps_its_shadow(seed: int) -> None:
    """One of 94 000 directions over a hemisphere hits the sun: a probe must also draw directions from the light."""
    radiance, sun = sun_and_sky(512)
    light = EnvironmentMap(radiance)
    scene, found = relighting_findings(run("occluder", seed), None, light)
    incident, plan = scene.incident, found.plan
    assert plan.visibility
    facing = scene.surfels.frame[..., 2] @ sun > 0.1
    towards_it = (incident.direction @ sun > 0.999) & facing[:, None]
    lit = (incident.visibility * towards_it).sum(1) / towards_it.sum(1).clamp(min=1)
    shadowed = towards_it.any(1) & (lit < 0.1)
    assert int(shadowed.sum()) > 20
    assert not relighting_findings(run("convex", seed), None, light)[1].plan.traces


def test_surfels_on_true_surfaces_have_the_true_materials() -> None:
    surfels, light = true_model(load_scene("convex"))
    assert torch.allclose(surfels.albedo, torch.tensor([0.6, 0.35, 0.2]).expand(len(surfels), 3), atol=1e-5)
    assert light.radiance.shape == (32, 64, 3)


@pytest.mark.slow
def test_a_probe_is_plain_data_with_an_image_for_each_effect() -> None:
    """A probe has the values that a command line prints and draws without knowing the method."""
    found = probe_run(run("patchwork", 0), None, None)
    assert [record.effect for record in found.records] == [*EFFECTS, "plan", "light-sampling"]
    assert json.loads(json.dumps(found.plain(), allow_nan=False)) == found.plain()
    assert set(found.differences) == set(EFFECTS)
    assert found.pictured
    (first,) = load(load_scene("patchwork").train[:1], torch.device("cpu"))
    assert torch.equal(found.reference, first.over(0.0))
    for change in found.differences.values():
        assert change.shape == found.reference.shape[:2]
        assert float(change.min()) >= 0
    # In a scene of adjacent tiles further bounces add no light.
    assert found.bounces == 1
    assert found.psnr == pytest.approx(-10 * math.log10(found.mse))
