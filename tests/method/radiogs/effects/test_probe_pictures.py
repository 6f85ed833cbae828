"""Probes compare the same images as training: with the variant's encoding, lit along the variant's rays."""

from dataclasses import replace
from typing import Any

import pytest
import torch

from probed_scenes import CLAY, cameras, found, grey, hidden, seen, sheet, shown, sky
from radiogs.effects.assessment import image_gradient
from radiogs.effects.image_share import image_share
from radiogs.effects.new_light import model_error, probe_relighting, scene_under
from radiogs.effects.plan_radiance import PlanRadiance
from radiogs.effects.probe_scene import ProbeRays, ProbeView, Viewpoints, trace_scene
from radiogs.effects.probing import difference_maps, probe_scene, probe_scene_of_model
from radiogs.model import Model
from radiogs.rays import RaySettings
from radiogs.settings import PRESETS, Variant
from radiogs_core.contract import Run
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.maps import radiance_maps
from radiogs_datasets import load_scene
from radiogs_datasets.generate.solids import Sphere
from scenes import sphere_scene, surfels_over

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
    share = image_share(cameras(), glowing)
    right, wrong = (model_error(glowing, Viewpoints(views, share, each)) for each in (straight, not straight))
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
    made = trace_scene(surfels, sky(), Viewpoints((), image_share((), surfels), straight=True), rays)
    cosine = (made.incident.direction * surfels.frame[:, None, :, 2]).sum(-1)[:, :16]
    assert (float(cosine.min()) > LOWEST) == floor


def test_rays_of_a_relighting_probe_start_at_the_offset_of_relighting() -> None:
    """Rays with a large offset hit nothing. In training, a probe's rays start beyond their footprint in any case."""
    surfels, light, far = sheet(), EnvironmentMap(sky()), RaySettings(world_offset=100.0)
    viewpoints = Viewpoints((), image_share((), surfels), straight=True)
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
