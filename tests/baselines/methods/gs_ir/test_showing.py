"""Rendering of a trained GS-IR model: facts, relighting, and restoring from its tensors."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from baselines.methods.irgs.world import grey
from baselines.methods.stage_two import GS_IR
from baselines.methods.trained_models import LATTICE, VOLUMES
from baselines.methods.trained_models import LOW_ROOF as ROOFED
from baselines.methods.trained_models import gs_ir as trained
from baselines.methods.trained_models import gs_ir_model as model
from known_ball import SCENE
from radiogs_baselines.methods.gs_ir.method import GS_IR_METHOD
from radiogs_baselines.methods.gs_ir.settings import PRESETS, Variant
from radiogs_baselines.methods.gs_ir.showing import TrainedGSIR, labels_of
from radiogs_core.errors import DataError
from radiogs_core.scene.light import EnvironmentMap

CAMERA = SCENE.test[0].camera


def test_the_model_is_restored_unchanged() -> None:
    logit = torch.randn(len(ROOFED))
    found = trained(log_environment=torch.randn(8, 16, 3), metallic_logit=logit)
    assert torch.equal(found.light.radiance, found.model.log_environment.exp())
    assert all(torch.equal(getattr(ROOFED, name), value) for name, value in found.model.surfels.parameters().items())
    assert found.model.metallic is not None
    torch.testing.assert_close(found.model.metallic, logit.sigmoid())
    again, first = (each.prepare().render(CAMERA) for each in (found, TrainedGSIR(found.model, found.run)))
    assert all(torch.equal(again[name], first[name]) for name in first)
    bare = trained(occlusion=None, irradiance=None)
    assert bare.model.occlusion is None
    assert bare.model.irradiance is None
    assert not bare.prepare().render(CAMERA)["indirect"].any()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"metallic_logit": torch.zeros(3)}, "metallic_logit"),
        ({"log_environment": torch.full((8, 16, 3), float("nan"))}, "log_environment"),
        ({"occlusion": {"coefficients": torch.zeros(4, 9)}}, "harmonics of the shape"),
        ({"occlusion": {"coefficients": torch.zeros(4, 16)}}, "none of its 4 probes"),
        ({"occlusion": {"probe": torch.zeros(5, dtype=torch.int64)}}, "each of its 16\\^3 corners"),
        ({"irradiance": {"coefficients": torch.zeros(125, 16)}}, "harmonics of the shape"),
        ({"irradiance": {"coefficients": torch.full((125, 9), float("inf"))}}, "NaN or infinite"),
        ({"irradiance": {"corners": 1}}, "1 corners along an edge"),
        ({"irradiance": {"edge": 0.0}}, "no cube"),
    ],
)
def test_a_damaged_model_is_refused(change: dict[str, Any], says: str) -> None:
    stored = model().tensors()
    for name, value in change.items():
        stored[name] = stored[name] | value if isinstance(value, dict) else value
    with pytest.raises(DataError, match=says):
        GS_IR_METHOD.restore(GS_IR.run_of(), stored)


def test_images_under_the_recovered_light_have_occlusion_and_indirect_light() -> None:
    own, bare = (each.prepare().render(CAMERA) for each in (trained(), trained(occlusion=None, irradiance=None)))
    assert own["indirect"].any()
    assert float((bare["direct"] - own["direct"]).max()) > 0.01
    relit = trained().prepare(grey()).render(CAMERA)
    torch.testing.assert_close(relit["direct"], bare["direct"])


def test_metalness_changes_images_under_both_lights() -> None:
    """Under a white light a metal's lobe contains more of its albedo; metalness 0 gives the plain model's image."""
    plain = trained(occlusion=None, irradiance=None)
    for logit, differs in ((-40.0, False), (2.0, True)):
        metal = trained(occlusion=None, irradiance=None, metallic_logit=torch.full((len(ROOFED),), logit))
        for light in (None, grey()):
            mine, theirs = (each.prepare(light).render(CAMERA)["direct"] for each in (metal, plain))
            assert (float((mine - theirs).abs().max()) > 0.01) == differs


def test_the_albedo_scale_applies_to_the_diffuse_part() -> None:
    twice = torch.tensor([2.0, 1.0, 0.5])
    one, scaled = (trained().prepare(grey(), factor).render(CAMERA) for factor in (None, twice))
    torch.testing.assert_close(scaled["albedo"], one["albedo"] * twice)
    torch.testing.assert_close(scaled["direct"] - one["direct"], one["albedo"] * (twice - 1), rtol=1e-3, atol=1e-4)


def test_new_lights_are_filtered_with_the_texel_areas_of_the_variant() -> None:
    exact, rough = (
        trained(GS_IR.variant(texel_areas=areas)).prepare(grey()).render(CAMERA) for areas in ("exact", "approximate")
    )
    seen = exact["alpha"][..., 0] > 0.9
    ratio = (rough["direct"] - exact["direct"])[seen] / exact["albedo"][seen]
    assert 0.04 < float(ratio.min()) < float(ratio.max()) < 0.12


@pytest.mark.parametrize("light", [None, grey(0.5)], ids=["recovered", "new"])
def test_lobes_have_the_masking_of_the_variant_which_is_the_exact_one_by_default(light: EnvironmentMap | None) -> None:
    default, exact, approximate = (
        trained(GS_IR.variant(**chosen)).prepare(light).render(CAMERA)["direct"]
        for chosen in ({}, {"masking": "height-correlated"}, {"masking": "schlick"})
    )
    assert torch.equal(default, exact)
    assert float(exact.mean()) > 1.005 * float(approximate.mean())


def test_exported_files_have_the_values_of_the_model(tmp_path: Path) -> None:
    found = trained(metallic_logit=torch.randn(len(ROOFED)))
    files = found.export(tmp_path)
    assert [path.name for path in files] == ["surfels.ply", "metallic.npy", "volumes.npz"]
    assert np.load(files[1]).shape == (len(ROOFED),)
    volumes = np.load(files[2])
    occlusion = VOLUMES["occlusion"]
    number = (3 * 16 + 4) * 16 + 5
    expected = occlusion.coefficients[occlusion.probe[number]]  # type: ignore[union-attr]
    assert np.array_equal(volumes["occlusion"][3, 4, 5], expected)
    assert volumes["irradiance"].shape == (5, 5, 5, 9)
    assert float(volumes["edge"]) == pytest.approx(LATTICE.edge)
    bare = trained(occlusion=None, irradiance=None).export(tmp_path / "..")
    assert [path.name for path in bare] == ["surfels.ply"]


def test_facts_list_reduced_settings_and_replacements() -> None:
    facts = trained().facts()
    assert facts["surfels"] == len(ROOFED)
    assert facts["probes"] == len(VOLUMES["occlusion"].coefficients)  # type: ignore[union-attr]
    assert facts["labels"]["stage1"].startswith("shared")
    assert f"occlusion_samples {GS_IR.budget.occlusion_samples} (published: 256)" in facts["labels"]["reduced"]
    assert facts["remarks"] == [f"{name}: {value}" for name, value in facts["labels"].items()]
    whole = labels_of(Variant(), PRESETS["paper"], 4.545)
    assert "reduced" not in whole
    assert "lr_scale" not in whole
    assert whole["tau"] == "0.25 world units (published: 0.25)"
    assert labels_of(Variant(tau=None), PRESETS["paper"], 1.0)["tau"].startswith("none")
    assert "0.2 world units" in labels_of(Variant(nearest=0.044), PRESETS["paper"], 4.545)["nearest"]
    assert labels_of(Variant(lr_scale=0.0), PRESETS["paper"], 1.0)["lr_scale"].startswith("0 of")
    assert labels_of(Variant(frame="as_shipped"), PRESETS["paper"], 1.0)["relight_frame"].startswith("Y-up")
    assert "tau" not in labels_of(Variant(occlusion=False), PRESETS["paper"], 1.0)
