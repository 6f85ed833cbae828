"""Probes of effects: what is kept in which scene, the pictures that are compared, and relighting."""

import dataclasses
import math
from dataclasses import replace
from typing import Any

import pytest
import torch
from scipy.spatial.transform import Rotation

from probed_scenes import CLAY, FLOOR, SAMPLES, cameras, found, grey, hidden, seen, sheet, shown, sky
from radiogs.effects.new_light import (
    model_error,
    plan_for_light,
    probe_relighting,
    reference_colour,
    scene_under,
    widened_light,
)
from radiogs.effects.plans import Step, plan_without
from radiogs.effects.probe import Assessment, Decision, accepted_plan, image_gradient
from radiogs.effects.probe_scene import PlanRadiance, ProbeRays, ProbeView, Viewpoints, trace_scene
from radiogs.effects.probing import difference_maps, probe_scene, probe_scene_of_model
from radiogs.model import Model
from radiogs.rays import RaySettings
from radiogs.settings import PRESETS, Variant
from radiogs_core.contract import Run
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.maps import radiance_maps
from radiogs_core.transport.plan import EffectPlan
from radiogs_core.transport.sampling import tangent_frame
from radiogs_datasets import load_scene
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.solids import Box, Sphere
from scenes import sphere_scene, sun_and_sky, surfels_over


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
    """0.3 % of the surfels stand around a pit of two pixels, for a method with a PSNR of 28 dB."""
    floor, ring = surfels_over([FLOOR], 0.05), pit()
    assert len(ring) / len(floor) < 0.004
    combined = {name: torch.cat([value, ring.parameters()[name]]) for name, value in floor.parameters().items()}
    made = seen(Surfels.of(combined), sky(), noise=0.04)
    assert found(made).plan.traces
    assert not found(seen(floor, sky(), noise=0.04)).plan.traces


def test_without_a_difference_between_images_a_gradient_keeps_the_rays() -> None:
    """The black table occludes only the black part of the sky for the floor, so that V changes no image. But without V
    the floor would give gradient to a part of the light that it cannot see."""
    floor = Box((-0.35, -0.35, -0.1), (0.35, 0.35, 0.0), CLAY)
    table = Box((-0.45, -0.45, 0.8), (0.45, 0.45, 0.85), Material((0.02, 0.02, 0.02), 0.9))
    light = sky()
    light[:5] = 1e-6  # more than 39 degrees high; the table's rim is at 45 degrees or higher
    made = seen(grey(surfels_over([floor, table], 0.12), 0.0), light)
    # All images are a tenth too bright, so that all gradients have one sign.
    darker = tuple(ProbeView(view.camera, 0.9 * view.target) for view in made.views if view.target is not None)
    made = dataclasses.replace(made, views=darker)
    record = found(made).evidence[0]
    assert record.effect == "visibility"
    assert record.measured.bound < 0.05
    assert record.measured.gradient > 0.25
    assert "gradients" in record.why
    assert record.verdict == "on"


def test_lobes_of_rough_surfaces_are_left_out_and_of_smooth_ones_kept() -> None:
    for roughness in (0.98, 0.2):
        balls = surfels_over([Sphere((0.0, 0.0, 0.0), 0.8, Material((0.9, 0.9, 0.9), roughness))], 0.12)
        plan = found(seen(balls, sky(sun=8.0), noise=0.1), effects=("specular",)).plan
        assert plan.specular == (roughness < 0.5)


def test_zero_harmonics_are_left_out_and_others_are_kept() -> None:
    ball = grey(surfels_over([Sphere((0.0, 0.0, 0.0), 0.8, CLAY)], 0.08), 0.4)
    made = seen(ball, sky())
    assert found(made, effects=("view-dependence",)).plan.sh_degree == 0
    ball.sh[:, 2] = 0.3
    assert found(seen(ball, sky()), effects=("view-dependence",)).plan.sh_degree == 3


def test_a_probe_repeats_for_its_seed() -> None:
    ball = surfels_over([Sphere((0.0, 0.0, 0.0), 0.8, CLAY)], 0.15)
    assert found(seen(ball, sky())).evidence == found(seen(ball, sky())).evidence


def test_the_image_gradient_reaches_visible_surfels_alone() -> None:
    """It is zero for surfels that face away from the camera, and not for all."""
    ball = surfels_over([Sphere((0.0, 0.0, 0.0), 0.8, CLAY)], 0.25)
    made = seen(ball, sky())
    pull = image_gradient(PlanRadiance(made))
    assert float(pull.abs().max()) > 0
    behind = (PlanRadiance(made).outgoing * made.surfels.frame[:, None, :, 2]).sum(-1) < -0.2
    assert not pull[behind].any()


@pytest.mark.parametrize("refused", [{"visibility", "specular"}, {"visibility", "specular", "samples"}])
def test_effects_that_save_least_return_if_the_combination_costs_too_much(refused: set[str]) -> None:
    """The assessment refuses a plan that leaves out all of ``refused``; each effect alone passes."""
    effects = ("visibility", "specular", "samples")
    chosen = {name: Decision(plan_without(name), "off", "", None) for name in effects}

    class TogetherTooMuch(Assessment):
        def __init__(self) -> None:
            self.step = Step(100, 50, SAMPLES, 10)

        def measure(self, effect: str, plan: EffectPlan) -> Any:
            return None

        def decided(self, plan: EffectPlan, measured: Any) -> Decision:
            return Decision(plan, "on" if refused <= {*plan.off} else "off", "", None)

    found, left = accepted_plan(TogetherTooMuch(), chosen)
    plan = found.plan
    assert set(left) == {"visibility", "samples"}
    assert plan.off == ("visibility", "indirect", "samples")
    assert found.verdict == "off"


RELEASED = ("fixed-offset", "hemisphere-floor", "one-sided-rays", "premultiplied-encoding")
LOWEST = 0.17
"""Sine of 10 degrees, the lowest height of the released code's directions; rounded down."""


def ball() -> Surfels:
    return surfels_over([Sphere((0.0, 0.0, 0.0), 0.8, CLAY)], 0.12)


@pytest.mark.parametrize("straight", [True, False])
def test_a_model_compared_with_its_own_images_has_no_error_and_no_gradient(straight: bool) -> None:
    """At silhouettes, where pixels are partly covered, the other encoding has an error as large as a good method's."""
    made = seen(ball(), sky(), noise=0.0, straight=straight)
    other = replace(made, straight=not straight)
    assert found(made).tolerance.mse < 1e-12
    assert found(other).tolerance.mse > 1e-5
    right, wrong = (float(image_gradient(PlanRadiance(each)).abs().max()) for each in (made, other))
    assert right < 1e-4 * wrong


@pytest.mark.parametrize("straight", [True, False])
def test_the_model_error_for_relighting_uses_the_variants_image_encoding(straight: bool) -> None:
    glowing = grey(ball(), 0.4)
    views = tuple(ProbeView(camera, radiance_maps(camera, glowing, straight)["image"]) for camera in cameras())
    right, wrong = (model_error(glowing, Viewpoints(views, each)) for each in (straight, not straight))
    assert right < 1e-12
    assert wrong > 1e-5


@pytest.mark.parametrize("straight", [True, False])
def test_the_reference_of_difference_maps_is_the_image_that_evaluation_renders(straight: bool) -> None:
    made = seen(sheet(), sky(), straight=straight)
    full, differences = difference_maps(made, ("visibility",))
    torch.testing.assert_close(full.clamp(0, 1), shown(made, cameras()[0]), rtol=0, atol=1e-5)
    # In hardly covered pixels the change of straight colour is small; premultiplied encoding amplifies it.
    doubled = replace(made, straight=not straight)
    assert not torch.allclose(difference_maps(doubled, ("visibility",))[1]["visibility"], differences["visibility"])


def test_only_rays_that_hit_backs_find_the_occlusion_under_a_one_sided_sheet() -> None:
    two_sided, one_sided = (
        seen(sheet(), sky(), variant=rays) for rays in (RaySettings(), RaySettings(back_offset=None))
    )
    assert bool((hidden(two_sided) > 0.25).all())
    assert bool((hidden(one_sided) < 0.01).all())
    assert found(two_sided).plan.visibility
    assert not found(one_sided).plan.traces


@pytest.mark.parametrize("drawn", [0, 8])
@pytest.mark.parametrize("floor", [True, False])
def test_directions_of_a_probe_have_the_variants_floor(drawn: int, floor: bool) -> None:
    surfels = ball()
    rays = ProbeRays(16, torch.Generator().manual_seed(0), RaySettings(floor=floor), drawn=drawn)
    made = trace_scene(surfels, sky(), Viewpoints((), straight=True), rays)
    cosine = (made.incident.direction * surfels.frame[:, None, :, 2]).sum(-1)[:, :16]
    assert (float(cosine.min()) > LOWEST) == floor


def test_rays_of_a_relighting_probe_start_at_the_offset_of_relighting() -> None:
    """Rays with a large offset hit nothing. In training, a probe's rays start beyond their footprint in any case."""
    surfels, light, far = sheet(), EnvironmentMap(sky()), RaySettings(world_offset=100.0)
    viewpoints = Viewpoints((), straight=True)
    near, away = (scene_under(surfels, surfels.albedo, light, viewpoints, 0, rays) for rays in (RaySettings(), far))
    assert bool((hidden(near) > 0.25).all())
    assert bool((away.incident.visibility == 1).all())
    generator = torch.Generator().manual_seed(0)
    assert bool((hidden(trace_scene(surfels, light.radiance, viewpoints, ProbeRays(16, generator, far))) > 0.25).all())


def probes_of(variant: Variant) -> dict[str, Any]:
    """The scenes of all kinds of probes with a variant."""
    run = Run(sphere_scene(), variant, PRESETS["smoke"], 0, torch.device("cpu"))
    light = EnvironmentMap(sky())
    model = Model(sheet(), light.radiance.log())
    known = replace(run, scene=load_scene("convex"))
    return {
        "model": probe_scene_of_model(run, model),
        "relit": probe_relighting(model, light, torch.ones(3), run)[0],
        "truth": probe_scene(known)[0],
    }


@pytest.mark.slow
def test_every_probe_uses_the_runs_variant() -> None:
    ours, released = probes_of(Variant()), probes_of(Variant(deviations=RELEASED))
    samples = PRESETS["smoke"].incident_samples
    for name in ours:
        assert ours[name].straight
        assert not released[name].straight
        for made, floor in ((ours[name], False), (released[name], True)):
            spread = made.incident.direction[:, : min(8, samples)]
            cosine = (spread * made.surfels.frame[:, None, :, 2]).sum(-1)
            assert (float(cosine.min()) > LOWEST) == floor, name
        if name != "truth":
            assert bool((hidden(ours[name]) > 0.25).all())
            assert bool((hidden(released[name]) < 0.01).all())


def test_a_sun_needs_effects_that_an_even_light_does_not_need() -> None:
    """Under an even light two balls hardly shade each other; under a sun one casts a shadow on the other."""
    balls = [Sphere((-0.45, 0.0, 0.0), 0.3, CLAY), Sphere((0.5, 0.15, 0.75), 0.3, CLAY)]
    surfels = surfels_over(balls, 0.1)
    made = seen(surfels, sky())
    viewpoints = Viewpoints(made.views, made.straight)
    sunny = torch.full((16, 32, 3), 0.2)
    sunny[4, 15] = 100.0  # 39 degrees high, azimuth 6 degrees
    even, sun = (
        {
            record.effect: record
            for record in plan_for_light(
                scene_under(surfels, surfels.albedo, EnvironmentMap(light), viewpoints, 0, RaySettings()),
                model_error(surfels, viewpoints),
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
        assert much.contribution > 3 * little.contribution, effect
        assert sun[effect].verdict == "on"
        assert even[effect].verdict == "off"


def test_the_reference_of_light_sampling_resolves_a_sun_of_half_a_degree() -> None:
    """The closed form for rough surfaces is albedo (sky + E_sun n.s / pi); their lobes add a few per cent."""
    ball = surfels_over([Sphere((0.0, 0.0, 0.0), 0.8, Material((0.8, 0.8, 0.8), 0.99))], 0.25)
    light, sun = sun_and_sky(512)
    truth = reference_colour(ball, EnvironmentMap(light), torch.Generator().manual_seed(0))
    facing = (ball.frame[..., 2] @ sun).clamp(min=0)
    matt = srgb_encode(0.8 * (0.1 + 2.0 * facing / math.pi))
    ratio = truth[:, 0] / matt
    # Interpolation changes the solid angle of a sun of few texels; a lobe reflects 2 to 5 % of 0.8.
    assert float(ratio.min()) > 0.99
    assert float(ratio.max()) < 1.06


def test_a_widened_light_extends_each_texel_by_one() -> None:
    light = torch.zeros(5, 8, 3)
    light[2, 7], light[0, 3] = 9.0, 4.0
    widened = widened_light(EnvironmentMap(light)).radiance
    expected = torch.zeros(5, 8, 3)
    expected[1:4, [6, 7, 0]] = 9.0
    expected[:2, 2:5] = 4.0
    assert torch.equal(widened, expected)
