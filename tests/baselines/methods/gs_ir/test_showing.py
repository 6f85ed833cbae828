"""A trained GS-IR model, beside the properties of all methods that ``test_trained`` tests."""

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
from radiogs_core.errors import DataError

CAMERA = SCENE.test[0].camera


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


def test_metalness_changes_images_under_both_lights() -> None:
    """Under a white light a metal's lobe contains more of its albedo; metalness 0 gives the plain model's image."""
    plain = trained(occlusion=None, irradiance=None)
    for logit, differs in ((-40.0, False), (2.0, True)):
        metal = trained(occlusion=None, irradiance=None, metallic_logit=torch.full((len(ROOFED),), logit))
        for light in (None, grey()):
            mine, theirs = (each.prepare(light).render(CAMERA)["direct"] for each in (metal, plain))
            assert (float((mine - theirs).abs().max()) > 0.01) == differs


def test_new_lights_are_filtered_with_the_texel_areas_of_the_variant() -> None:
    exact, rough = (
        trained(GS_IR.variant(texel_areas=areas)).prepare(grey()).render(CAMERA) for areas in ("exact", "approximate")
    )
    seen = exact["alpha"][..., 0] > 0.9
    ratio = (rough["direct"] - exact["direct"])[seen] / exact["albedo"][seen]
    assert 0.04 < float(ratio.min()) < float(ratio.max()) < 0.12


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
