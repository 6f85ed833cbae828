"""Rendering of a trained IRGS model: facts, relighting, and restoring from its tensors."""

from dataclasses import replace

import pytest
import torch

from baselines.methods.irgs.world import DOWN, grey, sheet, together
from baselines.methods.stage_two import IRGS
from baselines.methods.trained_models import HIGH_ROOF as ROOFED
from baselines.methods.trained_models import irgs as trained
from known_ball import BALL, SCENE
from radiogs_baselines.methods.irgs.method import IRGS_METHOD
from radiogs_baselines.methods.irgs.settings import PRESETS, Variant
from radiogs_baselines.methods.irgs.showing import labels_of
from radiogs_core.on_surfels.model import LitSurfels as Model

CAMERA = SCENE.test[0].camera


def test_a_view_does_not_depend_on_views_rendered_before() -> None:
    light = grey()
    light.radiance[2, 3] = 5.0
    shown = trained().prepare(light)
    first = shown.render(CAMERA)["image"]
    shown.render(SCENE.test[1].camera)
    assert torch.equal(shown.render(CAMERA)["image"], first)


def test_the_recovered_light_and_the_model_are_restored_unchanged() -> None:
    light = torch.randn(8, 16, 3)
    found = IRGS_METHOD.restore(IRGS.run_of(), Model(ROOFED, light).tensors())
    assert torch.equal(found.light.radiance, light.exp())
    assert all(torch.equal(getattr(ROOFED, name), value) for name, value in found.model.surfels.parameters().items())


def test_the_albedo_scale_applies_to_seen_surfaces_and_if_scaled_to_hits() -> None:
    """Under a light of 1 the visible albedo is doubled; the albedo of the roof, which rays hit, only with "scaled"."""
    twice = torch.full((3,), 2.0)
    plain = trained().prepare(grey()).render(CAMERA)
    seen = trained().prepare(grey(), twice).render(CAMERA)
    both = trained(IRGS.variant(secondary_albedo="scaled")).prepare(grey(), twice).render(CAMERA)
    torch.testing.assert_close(seen["albedo"], 2 * plain["albedo"])
    lit = plain["indirect"].amax(-1) > 0.01
    assert bool(lit.any())
    torch.testing.assert_close(seen["direct"], both["direct"], rtol=0, atol=0)
    assert bool((both["indirect"][lit] > 1.2 * seen["indirect"][lit]).all())
    without = trained(IRGS.variant(relight_indirect=False)).prepare(grey(), twice).render(CAMERA)
    assert torch.equal(without["direct"], seen["direct"])
    assert not without["indirect"].any()


def test_images_under_the_recovered_light_have_the_indirect_light_of_training() -> None:
    assert trained().prepare().render(CAMERA)["indirect"].any()
    assert not trained(IRGS.variant(indirect="none")).prepare().render(CAMERA)["indirect"].any()


def test_facts_list_reduced_settings_and_replacements() -> None:
    facts = trained().facts()
    assert facts["surfels"] == len(ROOFED)
    assert facts["labels"]["stage1"].startswith("shared")
    assert f"incident_samples {IRGS.budget.incident_samples} (published: 256)" in facts["labels"]["reduced"]
    assert facts["remarks"] == [f"{name}: {value}" for name, value in facts["labels"].items()]
    whole = labels_of(Variant(), PRESETS["paper"], 1.0)
    assert "reduced" not in whole
    assert "lr_scale" not in whole
    assert labels_of(Variant(lr_scale=0.1), PRESETS["paper"], 1.0)["lr_scale"].startswith("0.1")
    assert "0.05 world units" in labels_of(Variant(ray_start=0.01), PRESETS["paper"], 5.0)["ray_start"]


@pytest.mark.parametrize(("start", "expected"), [(None, 0.0), (1e3, 1.0)])
def test_rays_hit_only_surfels_beyond_their_start(start: float | None, expected: float) -> None:
    """A roof over the ball; a little light from below its edge reaches the ball's sides."""
    roof = together(BALL, sheet(2.9, DOWN, scale=1e3))
    found = IRGS_METHOD.restore(
        IRGS.run_of(IRGS.variant(ray_start=start)), Model(roof, torch.zeros(8, 16, 3)).tensors()
    )
    maps = found.prepare().render(CAMERA)
    free = IRGS_METHOD.restore(IRGS.run_of(), Model(BALL, torch.zeros(8, 16, 3)).tensors()).prepare().render(CAMERA)
    up = maps["normal"][..., 2] > 0.8
    ratio = float(maps["direct"][up].mean() / free["direct"][up].mean())
    assert ratio == pytest.approx(expected, abs=0.1)


def test_labels_describe_the_budget_of_the_run() -> None:
    other = replace(IRGS.budget, incident_samples=256, pixels=1024)
    assert "incident_samples" not in labels_of(Variant(), other, 1.0)["reduced"]
