"""Rendering of a trained SVG-IR model: facts, relighting, and restoring from its tensors."""

from dataclasses import replace
from pathlib import Path

import torch

from baselines.methods.irgs.world import grey
from baselines.methods.stage_two import SVG_IR
from baselines.methods.svg_ir.world import model_of
from baselines.methods.trained_models import LOW_ROOF as ROOFED
from baselines.methods.trained_models import svg_ir as trained
from known_ball import SCENE
from radiogs_baselines.methods.svg_ir.method import SVG_IR_METHOD
from radiogs_baselines.methods.svg_ir.settings import PRESETS, Variant
from radiogs_baselines.methods.svg_ir.shading import downsampled
from radiogs_baselines.methods.svg_ir.showing import labels_of
from radiogs_core.scene.light import EnvironmentMap

CAMERA = SCENE.test[0].camera


def test_a_restored_model_is_unchanged_and_uses_the_table_of_training() -> None:
    stage = SVG_IR.stage_of()
    for _ in range(3):
        stage.step()
    found = SVG_IR_METHOD.restore(SVG_IR.run_of(), stage.product())
    assert torch.equal(found.light.radiance, stage.model.environment.detach())
    assert not torch.equal(found.model.cached.opacity_logit, found.model.surfels.opacity_logit)
    table = found.prepare().renderer.lit.table  # type: ignore[attr-defined]
    for name in ("direction", "visibility", "radiance", "hit_surfel", "hit_uv"):
        assert torch.equal(getattr(table, name), getattr(stage.table, name)), name


def test_the_albedo_scale_applies_to_seen_surfaces_and_to_hits() -> None:
    """The diffuse part is doubled twice; the lobes keep the factor below four."""
    twice = torch.full((3,), 2.0)
    plain, scaled = trained().prepare(grey()).render(CAMERA), trained().prepare(grey(), twice).render(CAMERA)
    torch.testing.assert_close(scaled["albedo"], 2 * plain["albedo"])
    lit = plain["indirect"].amax(-1) > 0.01
    assert bool(lit.any())
    ratio = float(scaled["indirect"][lit].mean() / plain["indirect"][lit].mean())
    assert 2.5 < ratio < 4
    without = trained(SVG_IR.variant(relight_indirect=False)).prepare(grey(), twice).render(CAMERA)
    assert torch.equal(without["direct"], scaled["direct"])
    assert not without["indirect"].any()


def test_images_under_the_recovered_light_have_the_indirect_light_of_training() -> None:
    assert trained().prepare().render(CAMERA)["indirect"].any()
    assert not trained(SVG_IR.variant(indirect=False)).prepare().render(CAMERA)["indirect"].any()


def test_the_ratio_is_not_used_in_relighting() -> None:
    model = model_of(ROOFED, grey(), ratio=3.0)
    found = SVG_IR_METHOD.restore(SVG_IR.run_of(), model.tensors()).prepare(grey()).render(CAMERA)
    assert torch.equal(found["image"], trained().prepare(grey()).render(CAMERA)["image"])


def test_a_new_light_is_downsampled_and_limited() -> None:
    sun = EnvironmentMap(torch.zeros(64, 128, 3))
    sun.radiance[3, 5] = 40.0
    small = downsampled(sun, 32)
    assert small.radiance.shape == (32, 64, 3)
    assert float(small.radiance[1, 2, 0]) == 10.0
    assert float(small.radiance.sum()) == 30.0
    assert downsampled(sun, None) is sun
    sharp = trained(SVG_IR.variant(relight_rows=None, light_limit=4.0)).prepare(sun)
    assert float(sharp.renderer.lit.environment.max()) == 4.0  # type: ignore[attr-defined]


def test_facts_list_reduced_settings_and_replacements() -> None:
    facts = trained().facts()
    assert facts["surfels"] == len(ROOFED)
    assert facts["ratio"] == 1.0
    assert facts["labels"]["stage1"].startswith("shared")
    assert f"incident_samples {SVG_IR.budget.incident_samples} (published: 64)" in facts["labels"]["reduced"]
    assert facts["remarks"] == [f"{name}: {value}" for name, value in facts["labels"].items()]
    assert "reduced" not in labels_of(Variant(), PRESETS["paper"], 1.0)
    assert labels_of(Variant(attributes="constant"), SVG_IR.budget, 1.0)["attributes"].startswith("constant-attribute")
    assert "0.22 world units" in labels_of(Variant(hop=0.044), SVG_IR.budget, 5.0)["hop"]
    assert "full length" in labels_of(Variant(hop=None), SVG_IR.budget, 5.0)["hop"]
    other = replace(SVG_IR.budget, incident_samples=64)
    assert "incident_samples" not in labels_of(Variant(), other, 1.0)["reduced"]


def test_exported_surfels_have_the_mean_material_of_their_vertices(tmp_path: Path) -> None:
    model = model_of(ROOFED, grey())
    logit = model.vertex_albedo_logit.clone()
    logit[:, 0] = 3.0
    uneven = SVG_IR_METHOD.restore(SVG_IR.run_of(), replace(model, vertex_albedo_logit=logit).tensors())
    torch.testing.assert_close(uneven.model.averaged().albedo, uneven.model.albedo.mean(1))
    assert [path.name for path in uneven.export(tmp_path)] == ["surfels.ply"]
    assert (tmp_path / "surfels.ply").stat().st_size > 0
