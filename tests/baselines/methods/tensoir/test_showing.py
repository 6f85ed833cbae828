"""Rendering of a trained TensoIR model: facts, relighting, and restoring from its tensors."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from baselines.methods.tensoir.world import BUDGET, grey, looking_down, run_of
from baselines.methods.trained_models import FLOOR
from baselines.methods.trained_models import tensoir as trained
from radiogs_baselines.methods.tensoir.light import SphericalGaussians
from radiogs_baselines.methods.tensoir.method import TENSOIR_METHOD
from radiogs_baselines.methods.tensoir.model import Model
from radiogs_baselines.methods.tensoir.settings import PRESETS, Variant
from radiogs_baselines.methods.tensoir.showing import labels_of
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.scene.light import texel_directions

CAMERA = looking_down(size=5)


def test_maps_have_the_known_values_of_the_floor() -> None:
    maps = trained().prepare().render(CAMERA)
    whole = (CAMERA.height, CAMERA.width)
    torch.testing.assert_close(maps["alpha"], torch.ones(*whole, 1), rtol=1e-3, atol=0)
    torch.testing.assert_close(maps["albedo"], torch.full((*whole, 3), 0.4), rtol=1e-3, atol=0)
    torch.testing.assert_close(maps["roughness"], torch.full((*whole, 1), 0.54), rtol=1e-3, atol=0)
    torch.testing.assert_close(maps["normal"], torch.tensor([0.0, 0.0, 1.0]).expand(*whole, 3))
    # z-depth is the same in every pixel, though rays to the corners of this wide view are 15 % longer.
    wide = trained().prepare().render(replace(CAMERA, fx=5.0, fy=5.0))
    torch.testing.assert_close(wide["depth"], torch.full((*whole, 1), 1.4), rtol=0, atol=0.03)


def test_the_image_is_the_radiance_field_or_shaded() -> None:
    field = trained().prepare().render(CAMERA)
    torch.testing.assert_close(field["image"], srgb_encode(torch.full_like(field["image"], 0.3)), rtol=0, atol=2e-3)
    shaded = trained(Variant(shown="shaded")).prepare().render(CAMERA)
    torch.testing.assert_close(shaded["image"], srgb_encode(shaded["direct"] + shaded["indirect"]))
    assert not torch.allclose(shaded["image"], field["image"], atol=0.01)
    # A floor in light of 0.8: its albedo's part, and what the lobe adds.
    middle = shaded["direct"][2, 2]
    # The cosine's integral is exact for the middles of bands of equal height; the lobe's is 0.026 by these 32.
    torch.testing.assert_close(middle, torch.full((3,), 0.8 * (0.4 + 0.0262)), rtol=2e-3, atol=0)


def test_a_view_does_not_depend_on_views_rendered_before() -> None:
    light = grey()
    light.radiance[2, 3] = 5.0
    shown = trained().prepare(light)
    first = shown.render(CAMERA)["image"]
    shown.render(looking_down(0.5, 2))
    assert torch.equal(shown.render(CAMERA)["image"], first)


def test_the_albedo_scale_applies_to_the_diffuse_part() -> None:
    twice = torch.full((3,), 2.0)
    plain, scaled = (trained().prepare(grey(), factor).render(CAMERA) for factor in (None, twice))
    torch.testing.assert_close(scaled["albedo"], 2 * plain["albedo"])
    gain = scaled["direct"] - plain["direct"]
    # The lobe is the same: what is added is the diffuse part, 0.4 under a light of 1, as noisy as 8 directions are.
    lobe = plain["direct"] - gain
    assert bool((gain > 0).all())
    assert bool((lobe < gain).all())


def test_the_recovered_light_and_the_model_are_restored_unchanged() -> None:
    raw = torch.randn(5, 7)
    found = TENSOIR_METHOD.restore(run_of(), Model(FLOOR, SphericalGaussians(raw)).tensors())
    assert all(torch.equal(FLOOR.parameters[name], value) for name, value in found.model.field.parameters.items())
    assert torch.equal(found.model.field.box.occupied, FLOOR.box.occupied)
    environment = found.light
    direction = texel_directions(*environment.radiance.shape[:2], dtype=torch.float32)
    torch.testing.assert_close(environment.radiance, SphericalGaussians(raw).radiance(direction))


def test_export_writes_all_parameters_and_the_box(tmp_path: Path) -> None:
    (path,) = trained().export(tmp_path)
    with np.load(path) as stored:
        assert set(stored) == {*FLOOR.parameters, "box_centre", "box_radius", "box_occupied"}
        for name, value in FLOOR.parameters.items():
            assert np.array_equal(stored[name], value.numpy())
        assert float(stored["box_radius"]) == FLOOR.box.radius


def test_facts_list_reduced_settings_and_replacements() -> None:
    facts = trained().facts()
    assert facts["grid"] == FLOOR.size
    assert facts["parameters"] == sum(value.numel() for value in FLOOR.parameters.values()) + 7
    assert f"grid_end {BUDGET.grid_end} (published: 300)" in facts["labels"]["reduced"]
    assert facts["remarks"] == [f"{name}: {value}" for name, value in facts["labels"].items()]
    whole = labels_of(Variant(), PRESETS["paper"])
    assert {"reduced", "ray_start", "network_rate"}.isdisjoint(whole)
    other = labels_of(Variant(shown="shaded"), replace(PRESETS["paper"], grid_end=64))
    assert other["nvs"].startswith("images under the recovered light are shaded")
    assert other["reduced"] == "grid_end 64 (published: 300)"
    assert "published: 0.05" in other["ray_start"]
