"""A trained SVG-IR model, beside the properties of all methods that ``test_trained`` tests."""

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
from radiogs_baselines.methods.svg_ir.shading import downsampled
from radiogs_core.scene.light import EnvironmentMap
from surfel_files import read_ply

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


def test_the_albedo_scale_applies_to_hits() -> None:
    """The diffuse part is doubled twice; the lobes keep the factor below four."""
    twice = torch.full((3,), 2.0)
    plain, scaled = trained().prepare(grey()).render(CAMERA), trained().prepare(grey(), twice).render(CAMERA)
    lit = plain["indirect"].amax(-1) > 0.01
    assert bool(lit.any())
    ratio = float(scaled["indirect"][lit].mean() / plain["indirect"][lit].mean())
    assert 2.5 < ratio < 4


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


def test_exported_surfels_have_the_mean_material_of_their_vertices(tmp_path: Path) -> None:
    model = model_of(ROOFED, grey())
    logit = model.vertex_albedo_logit.clone()
    logit[:, 0] = 3.0
    uneven = SVG_IR_METHOD.restore(SVG_IR.run_of(), replace(model, vertex_albedo_logit=logit).tensors())
    torch.testing.assert_close(uneven.model.averaged().albedo, uneven.model.albedo.mean(1))
    (path,) = uneven.export(tmp_path)
    torch.testing.assert_close(read_ply(path).albedo, uneven.model.albedo.mean(1))
