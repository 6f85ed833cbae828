"""Probes on surfels whose answer is known, and on scenes made to deceive them: nothing needed goes off for all."""

import copy
import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import pytest
import torch
from scipy.spatial.transform import Rotation

from radiogs.budget import PRESETS
from radiogs.effects.decide.assessment import Assessment
from radiogs.effects.decide.new_light import concentration, model_error, plan_for_light, reference_colour, scene_under
from radiogs.effects.decide.planner import Planner
from radiogs.effects.decide.probe import Findings, Occasion, _accepted, probe
from radiogs.effects.decide.staleness import Staleness, decide_refresh
from radiogs.effects.decide.tolerance import Tolerance
from radiogs.effects.measure.gradient import image_gradient
from radiogs.effects.measure.image_share import image_share
from radiogs.effects.measure.plan_radiance import PlanRadiance
from radiogs.effects.measure.probe_scene import (
    SHARP_ROUGHNESS,
    KeptLight,
    ProbeRays,
    ProbeScene,
    ProbeView,
    Viewpoints,
    trace_scene,
)
from radiogs.effects.measure.step_cost import Step
from radiogs.stages import Initialisation, InverseRendering
from radiogs.variant import Variant
from radiogs_core.instruments import recording
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.scene.light import EnvironmentMap, texel_directions
from radiogs_core.surfels.surfels import Surfels, radiance_to_sh
from radiogs_core.transport.incident import unoccluded
from radiogs_core.transport.plan import EffectPlan, everything
from radiogs_core.transport.sampling import hemisphere_directions, tangent_frame
from radiogs_core.transport.splatting import shaded_maps
from radiogs_core.transport.tracer import SurfelTracer, incident_along
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.solids import Box, Sphere
from scenes import look_at, sphere_scene, sun_and_sky, surfels_over

SAMPLES = 32
CLAY = Material((0.6, 0.5, 0.4), 0.7)
FLOOR = Box((-0.8, -0.8, -0.1), (0.8, 0.8, 0.0), CLAY)


def sky(sun: float = 0.0, sharpness: float = 60.0) -> torch.Tensor:
    """Grey above, darker below; ``sun``: radiance of a lobe 45 degrees high."""
    direction = texel_directions(16, 32).float()
    towards = torch.nn.functional.normalize(torch.tensor([1.0, 0.3, 1.0]), dim=0)
    glow = sun * torch.exp(sharpness * ((direction @ towards) - 1))
    return (0.6 + 0.3 * direction[..., 2:] + glow[..., None]).expand(16, 32, 3).contiguous()


def cameras(height: float = 2.5) -> list[Any]:
    places = [torch.tensor([2.5 * math.cos(a), 2.5 * math.sin(a), height]) for a in (0.2, 1.8, 3.3, 4.9)]
    return [look_at(place, torch.zeros(3), 32, 40.0) for place in places]


def seen(surfels: Surfels, light: torch.Tensor, noise: float = 0.02, seed: int = 0) -> ProbeScene:
    """PosedImage under that light with everything on, as a method sees it whose images are off by ``noise``."""
    blind = tuple(ProbeView(camera, None) for camera in cameras())
    rays = ProbeRays(SAMPLES, torch.Generator().manual_seed(seed), offset=0.1)
    made = trace_scene(surfels, light, Viewpoints(blind, image_share(cameras(), surfels)), rays, bounces=True)
    drawn = torch.Generator().manual_seed(99)
    views = tuple(
        ProbeView(view.camera, image + noise * torch.randn(image.shape, generator=drawn))
        for view in blind
        for image in [shaded_maps(view.camera, made.surfels, made.surfels.albedo, made.incident, light)["image"]]
    )
    return dataclasses.replace(made, views=views)


def step(surfels: Surfels) -> Step:
    return Step(len(surfels), 256, SAMPLES, 100)


def found(made: ProbeScene, seed: int = 0, **more: Any) -> Findings:
    return probe(made, step(made.surfels), Occasion(seed), **more)


def grey(surfels: Surfels, radiance: float) -> Surfels:
    own = torch.zeros_like(surfels.sh)
    own[:, 0] = radiance_to_sh(torch.full((len(surfels), 3), radiance))
    return Surfels.of(surfels.parameters() | {"sh": own})


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_around_a_sphere_alone_nothing_is_traced(seed: int) -> None:
    ball = surfels_over([Sphere((0.0, 0.0, 0.0), 0.8, CLAY)], 0.12)
    plan = found(seen(ball, sky(), seed=seed), seed).plan
    assert not plan.traces


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_under_a_table_light_is_traced(seed: int) -> None:
    table = Box((-0.5, -0.5, 0.4), (0.5, 0.5, 0.45), Material((0.05, 0.05, 0.05), 0.8))
    made = seen(surfels_over([FLOOR, table], 0.12), sky(), seed=seed)
    assert found(made, seed).plan.visibility


def pit() -> Surfels:
    """Eight upright surfels, 12 cm across and 10 cm high, that face each other over the middle of the floor."""
    angle = torch.arange(8, dtype=torch.float64) * (2 * math.pi / 8)
    outwards = torch.stack([angle.cos(), angle.sin(), torch.zeros_like(angle)], -1)
    quaternion = Rotation.from_matrix(tangent_frame(-outwards).numpy()).as_quat(scalar_first=True)
    one = surfels_over([FLOOR], 0.4).take(torch.zeros(8, dtype=torch.long))
    centre = (0.06 * outwards + torch.tensor([0.0, 0.0, 0.05])).float()
    size = torch.full((8, 2), 0.03).log()
    changed = {"centre": centre, "rotation": torch.from_numpy(quaternion).float(), "log_scale": size}
    return Surfels.of(one.parameters() | changed)


def test_a_cavity_of_a_few_surfels_keeps_its_rays() -> None:
    """0.3 % of the surfels stand around a pit that is two pixels wide."""
    floor, ring = surfels_over([FLOOR], 0.05), pit()
    assert len(ring) / len(floor) < 0.004
    combined = {name: torch.cat([value, ring.parameters()[name]]) for name, value in floor.parameters().items()}
    made = seen(Surfels.of(combined), sky(), noise=0.005)
    plan = found(made).plan
    assert plan.traces
    if plan.traced is not None:
        # The ring hides the sky from the floor about it, too: what is traced lies there.
        near = made.surfels.centre.norm(dim=-1) < 0.2
        assert bool(plan.traced[near].any())
        assert not bool(plan.traced[~near].any())
        assert float(plan.traced.float().mean()) < 0.1


def test_without_a_difference_between_images_a_gradient_keeps_the_rays() -> None:
    """The black table hides none but the black part of the sky from the floor: V changes no image. But without V the
    floor would change a part of the light that it does not see."""
    floor = Box((-0.35, -0.35, -0.1), (0.35, 0.35, 0.0), CLAY)
    table = Box((-0.45, -0.45, 0.8), (0.45, 0.45, 0.85), Material((0.02, 0.02, 0.02), 0.9))
    light = sky()
    light[:5] = 1e-6  # more than 39 degrees high; the table's rim is at 45 degrees or higher
    made = seen(grey(surfels_over([floor, table], 0.12), 0.0), light)
    # Everything is seen a tenth too bright: all pulls have one sign.
    darker = tuple(ProbeView(view.camera, 0.9 * view.target) for view in made.views if view.target is not None)
    made = dataclasses.replace(made, views=darker)
    record = found(made).evidence[0]
    assert record.effect == "visibility"
    assert record.measured is not None
    assert record.measured.bound < 0.05
    assert record.measured.gradient > 0.25
    assert "gradients" in record.why
    assert record.verdict == "on"


def test_a_relighting_light_unlike_the_training_light_is_probed_anew() -> None:
    """Under an even light two balls hardly shade each other; a sun throws the shadow of one onto the other."""
    balls = [Sphere((-0.45, 0.0, 0.0), 0.3, CLAY), Sphere((0.5, 0.15, 0.75), 0.3, CLAY)]
    surfels = surfels_over(balls, 0.1)
    made = seen(surfels, sky())
    sunny = torch.full((16, 32, 3), 0.2)
    sunny[4, 15] = 100.0  # 39 degrees high, azimuth 6 degrees
    even, sun = (
        {
            record.effect: record
            for record in plan_for_light(
                scene_under(surfels, surfels.albedo, EnvironmentMap(light), Viewpoints(made.views, made.share), 0),
                model_error(surfels, made.views),
                32,
                32,
                0,
                decibel=1.0,
            ).evidence
        }
        for light in (torch.full((16, 32, 3), 0.7), sunny)
    )
    for effect in ("visibility", "light-sampling"):
        little, much = even[effect].measured, sun[effect].measured
        assert little is not None
        assert much is not None
        assert much.contribution > 3 * little.contribution, effect
        assert sun[effect].verdict == "on"
        assert even[effect].verdict == "off"


def test_the_truth_that_light_sampling_is_judged_by_has_a_sun_of_half_a_degree() -> None:
    """Of rough surfaces by closed form, albedo (sky + E_sun n.s / pi); their lobes add a few per cent of it."""
    ball = surfels_over([Sphere((0.0, 0.0, 0.0), 0.8, Material((0.8, 0.8, 0.8), 0.99))], 0.25)
    light, sun = sun_and_sky(512)
    truth = reference_colour(ball, EnvironmentMap(light), torch.Generator().manual_seed(0))
    facing = (ball.frame[..., 2] @ sun).clamp(min=0)
    matt = srgb_encode(0.8 * (0.1 + 2.0 * facing / math.pi))
    ratio = truth[:, 0] / matt
    # The solid angle that a sun of few texels is read over differs from theirs; a lobe reflects 2 to 5 % of 0.8.
    assert float(ratio.min()) > 0.99
    assert float(ratio.max()) < 1.06


def test_the_concentration_of_a_light_is_that_of_its_texels() -> None:
    assert concentration(EnvironmentMap(torch.full((8, 16, 3), 0.3))).effective == pytest.approx(1.0)
    spot = torch.zeros(8, 16, 3)
    spot[3, 5] = 9.0
    assert concentration(EnvironmentMap(spot)).effective < 0.02
    assert concentration(EnvironmentMap(torch.zeros(8, 16, 3))).effective == 1.0


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_specular_parts_stay_where_they_show(seed: int) -> None:
    shiny = surfels_over([Sphere((0.0, 0.0, 0.0), 0.8, Material((0.04, 0.04, 0.04), 0.2))], 0.12)
    assert found(seen(shiny, sky(sun=8.0), seed=seed), seed).plan.specular


def test_a_specular_part_that_shows_only_when_smooth_is_kept() -> None:
    """While roughness may yet be learnt, what it could still do counts as much as what it does; later it does not."""
    rough = surfels_over([Sphere((0.0, 0.0, 0.0), 0.8, Material((0.9, 0.9, 0.9), 0.98))], 0.12)
    final = seen(rough, sky(sun=8.0), noise=0.1)
    learning = dataclasses.replace(final, sharpest=SHARP_ROUGHNESS)
    assert found(learning, effects=("specular",)).plan.specular
    assert not found(final, effects=("specular",)).plan.specular


def test_a_probe_during_training_knows_that_roughness_may_yet_be_learnt() -> None:
    ball = surfels_over([Sphere((0.0, 0.0, 0.0), 0.8, CLAY)], 0.25)
    assert Planner("auto", 0, 40, SAMPLES).scene(ball, sky(), (), 0).sharpest == SHARP_ROUGHNESS


def test_harmonics_that_carry_nothing_are_left_out_and_others_are_kept() -> None:
    ball = grey(surfels_over([Sphere((0.0, 0.0, 0.0), 0.8, CLAY)], 0.08), 0.4)
    made = seen(ball, sky())
    assert found(made, effects=("view-dependence",)).plan.sh_degree == 0
    ball.sh[:, 2] = 0.3
    assert found(seen(ball, sky()), effects=("view-dependence",)).plan.sh_degree == 1


def test_bolder_masks_leave_out_more_and_masked_images_lie_between() -> None:
    table = Box((-0.5, -0.5, 0.4), (0.5, 0.5, 0.45), CLAY)
    made = seen(surfels_over([FLOOR, table], 0.12), sky())
    radiance = PlanRadiance(made)
    full = radiance.shaded(everything()).detach()
    masks = [made.occlusion > edge for edge in (0.05, 0.2, 0.4)]
    reduced = [radiance.shaded(EffectPlan(traced=mask)).detach() for mask in masks]
    changes = [float((each - full).square().mean()) for each in reduced]
    assert changes == sorted(changes)
    everywhere = EffectPlan(traced=torch.ones(len(made.surfels), dtype=torch.bool))
    assert torch.equal(radiance.shaded(everywhere).detach(), full)


def test_a_probe_repeats_for_its_seed() -> None:
    ball = surfels_over([Sphere((0.0, 0.0, 0.0), 0.8, CLAY)], 0.15)
    assert found(seen(ball, sky())).evidence == found(seen(ball, sky())).evidence


def test_gradients_are_pulled_by_the_images_errors() -> None:
    """Against central differences of the images' squared error, in the radiance of one surfel."""
    ball = surfels_over([Sphere((0.0, 0.0, 0.0), 0.8, CLAY)], 0.25)
    made = seen(ball, sky())
    pull = image_gradient(PlanRadiance(made))
    assert float(pull.abs().max()) > 0
    behind = (PlanRadiance(made).outgoing * made.surfels.frame[:, None, :, 2]).sum(-1) < -0.2
    assert not pull[behind].any()


CPU = torch.device("cpu")
BUDGET = dataclasses.replace(PRESETS["smoke"], initialise_iterations=24, densify_interval=8, initial_surfels=120)


@pytest.fixture(scope="module")
def initialised() -> dict[str, Any]:
    stage = Initialisation(sphere_scene(views=4, size=16), Variant(), BUDGET, 0, CPU)
    for _ in range(stage.iterations):
        stage.step()
    return stage.state()


def planned(initialised: dict[str, Any]) -> InverseRendering:
    scene = sphere_scene(views=4, size=16)
    return InverseRendering(scene, Variant(effects="auto"), BUDGET, 0, CPU, initialised)


def test_a_probe_that_fails_turns_everything_on(initialised: dict[str, Any]) -> None:
    stage = planned(initialised)
    stage.shader.planner.plan = everything().without("indirect").without("visibility")
    stage.initialised = copy.deepcopy(initialised)
    stage.initialised["optimiser"]["tensors"]["sh"][:] = torch.nan
    stage.step()
    assert stage.shader.plan == everything()
    assert "failed" in stage.shader.planner.evidence[-1].why


@dataclasses.dataclass(frozen=True)
class View:
    """A training view as a planner needs it."""

    camera: Any
    image: torch.Tensor

    def over(self, background: float) -> torch.Tensor:
        return self.image


def views_of(made: ProbeScene) -> list[View]:
    return [View(view.camera, view.target) for view in made.views if view.target is not None]


def without_rays() -> Planner:
    """A planner that has left out all rays."""
    planner = Planner("auto", 0, 30, SAMPLES)
    planner.plan = dataclasses.replace(everything().without("indirect").without("visibility"), kept=True)
    return planner


WALL = Box((-0.7, -0.02, 0.002), (0.7, 0.02, 0.6), CLAY)


def test_an_effect_that_appears_during_training_is_switched_on_again() -> None:
    """A plan without rays, made while nothing was in the way, meets a wall that has come between."""
    planner = without_rays()
    surfels = surfels_over([FLOOR, WALL], 0.12)
    assert planner.due(15)
    changed = planner.observe(surfels, sky(), views_of(seen(surfels, sky())), step(surfels), 15)
    assert changed
    assert planner.plan.visibility


@pytest.mark.parametrize("moved", [False, True])
def test_light_is_kept_as_long_as_rays_find_the_same(moved: bool) -> None:
    """Light that was kept since before a wall came is given up; light that knows the wall is as good as rays."""
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


def test_rays_of_probes_are_not_traced_from_surfels_whose_light_was_traced_anew() -> None:
    surfels = surfels_over([FLOOR, WALL], 0.12)
    made = seen(surfels, sky())
    direction, weight = hemisphere_directions(surfels.frame[..., 2], SAMPLES // 2, None)
    mask = torch.arange(len(surfels)) % 3 == 0
    lit = unoccluded(direction[mask], weight[mask])
    kept = KeptLight(mask, lit, dataclasses.replace(lit, visibility=0.5 * lit.visibility))
    with recording() as instruments:
        found = Planner("auto", 0, 30, SAMPLES).scene(surfels, sky(), views_of(made), 5, kept)
    assert instruments.work["rays"] == int((~mask).sum()) * SAMPLES // 2
    assert torch.equal(found.incident.direction[mask], direction[mask])
    assert (found.incident.visibility[mask] == 0.5).all()
    assert (found.untraced.visibility[mask] == 1).all()
    assert found.incident.radiance[~mask].any()


def test_a_cache_that_stays_fresh_is_refreshed_less_often_and_a_stale_one_again() -> None:
    tolerance, budgeted = Tolerance(1e-3), Step(2500, 64, 32, 20)
    still = Staleness(1e-9 * torch.rand(200))
    factor, record = decide_refresh(still, tolerance, budgeted, Occasion(0, 10), 1e-3)
    assert (factor, record.verdict) == (2, "off")
    moving = Staleness(1e-2 * torch.rand(200))
    factor, record = decide_refresh(moving, tolerance, budgeted, Occasion(0, 20, EffectPlan(refresh=2)), 1e-3)
    assert (factor, record.verdict) == (1, "on")


@pytest.mark.parametrize("refused", [{"visibility", "indirect"}, {"visibility", "indirect", "samples"}])
def test_of_effects_that_only_together_cost_too_much_those_that_save_most_stay_out(refused: set[str]) -> None:
    """An assessment that refuses plans which leave out all of ``refused``; each alone passes."""
    local = EffectPlan(traced=torch.arange(100) < 30)
    chosen = {
        "visibility": local,
        "indirect": everything().without("indirect"),
        "samples": everything().without("samples"),
    }

    class TogetherTooMuch(Assessment):
        def __init__(self) -> None:
            self.step, self.seed, self.tolerance = Step(100, 50, SAMPLES, 10), 0, Tolerance(1e-3)

        def measure(self, asked_of: Sequence[tuple[str, EffectPlan]]) -> list[Any]:
            return [None] * len(asked_of)

        def decided(self, effect: str, plan: EffectPlan, measured: Any, before: EffectPlan) -> tuple[Any, str, Any]:
            left_out = {
                name
                for name, out in (
                    ("visibility", plan.traced is not None),
                    ("indirect", not plan.indirect),
                    ("samples", plan.samples > 1),
                )
                if out
            }
            return ("on" if refused <= left_out else "off", "", None)

    plan, record, left = _accepted(TogetherTooMuch(), chosen, everything(), 7)
    assert set(left) == {"visibility", "samples"}
    assert plan.indirect
    assert plan.traced is local.traced
    assert plan.samples == 2
    assert (record.verdict, record.iteration) == ("off", 7)
