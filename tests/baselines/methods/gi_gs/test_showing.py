"""A trained GI-GS model, beside the properties of all methods that ``test_trained`` tests."""

from dataclasses import replace

import pytest
import torch

from baselines.methods.irgs.world import grey
from baselines.methods.stage_two import GI_GS, STANDING
from baselines.methods.trained_models import gi_gs as trained
from known_ball import SCENE
from radiogs_baselines.methods.gi_gs.method import GI_GS_METHOD
from radiogs_baselines.methods.gs_ir.metallic import MetallicSurfels
from radiogs_core.scene.colour import srgb_encode

CAMERA = SCENE.test[0].camera


def test_relighting_is_not_occluded_and_has_the_bounce_of_the_new_light() -> None:
    """Relit by the recovered light, the images differ from the unrelit ones only in the occlusion, which is 1."""
    own = trained(GI_GS.variant(occlusion=False)).prepare().render(CAMERA)
    occluded = trained().prepare().render(CAMERA)
    relit = trained().prepare(grey()).render(CAMERA)
    for name in ("direct", "indirect", "image"):
        torch.testing.assert_close(relit[name], own[name], rtol=1e-5, atol=1e-6)
    assert float((relit["direct"] - occluded["direct"]).max()) > 0.01
    assert float(relit["indirect"].max()) > 0.01
    dimmer = trained().prepare(grey(0.25)).render(CAMERA)
    torch.testing.assert_close(dimmer["indirect"], 0.25 * relit["indirect"], rtol=1e-4, atol=1e-6)


def test_under_the_recovered_light_images_are_shaded_as_in_training() -> None:
    full = trained().prepare().render(CAMERA)
    linear = trained(GI_GS.variant(sum="linear")).prepare().render(CAMERA)
    alpha = full["alpha"]
    both = srgb_encode((full["direct"] + full["indirect"]) / alpha.clamp(min=1e-9)) * alpha
    torch.testing.assert_close(linear["image"], both.clamp(0, 1), rtol=1e-4, atol=1e-5)
    assert float((full["image"] - linear["image"]).max()) > 0.01


def test_images_of_the_readme_variant_have_occlusion() -> None:
    found = trained(GI_GS.variant(readme_bug=True)).prepare().render(CAMERA)
    assert torch.equal(found["image"], trained().prepare().render(CAMERA)["image"])
    assert not trained(GI_GS.variant(start=16)).prepare().render(CAMERA)["indirect"].any()


def test_the_albedo_scale_applies_to_gathered_surfaces() -> None:
    plain, twice = (trained().prepare(grey(0.5), torch.full((3,), scale)).render(CAMERA) for scale in (1.0, 2.0))
    lit = plain["indirect"].amax(-1) > 0.01
    assert bool((twice["indirect"][lit] > 2.5 * plain["indirect"][lit]).all()), "twice the albedo, and what it meets"


def test_rendered_frames_use_the_render_grid() -> None:
    fine = replace(GI_GS.budget, render_azimuths=32, render_heights=17)
    model = MetallicSurfels(STANDING, torch.zeros(8, 16, 3)).tensors()
    found = GI_GS_METHOD.restore(GI_GS.run_of(budget=fine), model).prepare().render(CAMERA)
    coarse, near = trained().prepare().render(CAMERA), found["direct"]
    assert not torch.equal(found["indirect"], coarse["indirect"])
    ratio = float(found["indirect"].mean() / coarse["indirect"].mean())
    assert ratio == pytest.approx(1.0, abs=0.25), "every grid is weighted to the same share"
    assert not torch.equal(near, coarse["direct"])


def test_metalness_changes_the_image() -> None:
    metal = trained(metallic=torch.full((len(STANDING),), 3.0)).prepare().render(CAMERA)
    plain = trained().prepare().render(CAMERA)
    assert float(metal["direct"].mean()) > float(plain["direct"].mean())
    assert float(metal["indirect"].mean()) < 0.5 * float(plain["indirect"].mean())
