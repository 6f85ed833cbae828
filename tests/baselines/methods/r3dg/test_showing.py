"""Rendering of a trained R3DG model: facts, relighting, and restoring from its tensors."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from baselines.methods.irgs.world import grey
from baselines.methods.r3dg.world import around
from baselines.methods.stage_two import R3DG
from baselines.methods.trained_models import HIGH_ROOF as ROOFED
from baselines.methods.trained_models import r3dg as trained
from known_ball import SCENE
from radiogs_baselines.methods.r3dg.method import R3DG_METHOD
from radiogs_baselines.methods.r3dg.model import Model
from radiogs_baselines.methods.r3dg.settings import PRESETS, Variant
from radiogs_baselines.methods.r3dg.showing import labels_of
from surfel_files import read_ply

CAMERA = SCENE.test[0].camera


def test_the_recovered_light_and_the_model_are_restored_unchanged() -> None:
    light, local = torch.randn(8, 16, 3), torch.randn(len(ROOFED), 16, 3)
    found = R3DG_METHOD.restore(R3DG.run_of(), Model(ROOFED, local, light).tensors())
    assert torch.equal(found.light.radiance, torch.nn.functional.softplus(light))
    assert torch.equal(found.model.local, local)
    assert all(torch.equal(getattr(ROOFED, name), value) for name, value in found.model.surfels.parameters().items())


def test_the_albedo_scale_applies_to_the_diffuse_part() -> None:
    """It scales direct and local light alike; the lobe does not change."""
    images = [trained().prepare(grey(), torch.full((3,), factor)).render(CAMERA) for factor in (1.0, 2.0, 3.0)]
    torch.testing.assert_close(images[1]["albedo"], 2 * images[0]["albedo"])
    for name in ("direct", "indirect"):
        one, two, three = (image[name] for image in images)
        torch.testing.assert_close(three - two, two - one, rtol=1e-3, atol=1e-6)
        assert float((two - one).max()) > 0


def test_images_under_the_recovered_light_have_the_local_light_of_training() -> None:
    assert trained(R3DG.variant(relight_local_light=False)).prepare().render(CAMERA)["indirect"].any()
    assert not trained(R3DG.variant(local_light="none")).prepare().render(CAMERA)["indirect"].any()


def test_export_writes_the_surfels_and_the_local_light(tmp_path: Path) -> None:
    surfels, local = trained().export(tmp_path)
    torch.testing.assert_close(read_ply(surfels).albedo, ROOFED.albedo)
    np.testing.assert_array_equal(np.load(local), around(ROOFED, 0.2).numpy())


def test_facts_list_reduced_settings_and_replacements() -> None:
    facts = trained().facts()
    assert facts["surfels"] == len(ROOFED)
    assert facts["labels"]["stage1"].startswith("shared")
    assert f"incident_samples {R3DG.budget.incident_samples} (published: 64)" in facts["labels"]["reduced"]
    assert facts["remarks"] == [f"{name}: {value}" for name, value in facts["labels"].items()]
    whole = labels_of(Variant(), PRESETS["paper"], 1.0)
    assert "reduced" not in whole
    assert "local_rate" not in whole
    assert labels_of(Variant(), replace(PRESETS["paper"], local_rate=2.0), 1.0)["local_rate"].startswith("2 times")
    assert "0.05 world units" in labels_of(Variant(ray_start=0.01), PRESETS["paper"], 5.0)["ray_start"]
    assert labels_of(Variant(floor=True), PRESETS["paper"], 1.0)["directions"].endswith("as published")
