"""The maps that are computed from Cycles' passes."""

from pathlib import Path

import numpy as np
import pytest

from datasets.blend.multilayer import passes, write_multilayer
from radiogs_core.errors import DataError
from radiogs_datasets.blend.passes import maps_of, read_passes


def test_a_file_of_many_parts_is_read_whole(tmp_path: Path) -> None:
    made = passes(Normal=np.random.default_rng(0).normal(size=(4, 4, 3)))
    write_multilayer(tmp_path / "picture.exr", made)
    found = read_passes(tmp_path / "picture.exr")
    assert found.keys() == made.keys()
    assert all(np.array_equal(found[name], made[name]) for name in made)


def test_names_from_before_blender_5_mean_the_same(tmp_path: Path) -> None:
    made = passes()
    old = {"DiffInd": made.pop("Diffuse Indirect"), "Emit": made.pop("Emission")}
    write_multilayer(tmp_path / "picture.exr", made | old)
    assert np.array_equal(read_passes(tmp_path / "picture.exr")["Diffuse Indirect"], old["DiffInd"])


def test_what_is_no_picture_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "picture.exr").write_bytes(b"not an image")
    with pytest.raises(DataError, match="not what Blender was asked to write"):
        read_passes(tmp_path / "picture.exr")


@pytest.mark.parametrize("coverage", [1.0, 0.25])
def test_light_is_split_and_surfaces_are_straight(coverage: float) -> None:
    """Colour times light, over all lobes; albedo, roughness, depth and normals of the covered part alone."""
    lobes = {
        f"{lobe} Color": np.full((4, 4, 3), value * coverage)
        for lobe, value in (("Glossy", 0.2), ("Transmission", 0.1))
    }
    made = passes(4, coverage)
    made |= {name: value.astype(np.float32) for name, value in lobes.items()}
    made["Glossy Direct"][:], made["Glossy Indirect"][:] = 2.0, 0.5
    made["Transmission Direct"][:], made["Transmission Indirect"][:] = 3.0, 0.7
    made["Emission"][:] = 0.05 * coverage
    made["Combined"][..., :3] = (0.45 + 0.4 + 0.3 + 0.05 + 0.05 + 0.1 + 0.07) * coverage
    found = maps_of(made)
    assert found.direct == pytest.approx((0.45 + 0.4 + 0.3 + 0.05) * coverage, rel=1e-6)
    assert found.indirect == pytest.approx((0.05 + 0.1 + 0.07) * coverage, rel=1e-6)
    assert found.closure < 1e-6
    assert found.incident_indirect == pytest.approx(0.1, rel=1e-6)
    assert found.albedo == pytest.approx(0.5, rel=1e-6)
    assert found.depth == pytest.approx(3, rel=1e-6)
    assert found.roughness == pytest.approx(0.4, rel=1e-6)
    assert found.normal.reshape(-1, 3).tolist() == [[0, 0, 1]] * 16


def test_a_material_that_is_not_understood_has_blender_s_diffuse_colour_and_no_roughness() -> None:
    made = passes()
    made["known"][:2], made["albedo"][:2] = 0, 0
    made["Diffuse Color"][:] = 0.3
    found = maps_of(made)
    assert found.albedo[:2] == pytest.approx(0.3)
    assert found.albedo[2:] == pytest.approx(0.5)
    assert found.roughness is None


def test_where_nothing_is_there_is_nothing() -> None:
    found = maps_of(passes(4, 0.0))
    for name in ("image", "alpha", "direct", "indirect", "incident_indirect", "albedo", "normal", "depth"):
        assert not getattr(found, name).any(), name
    assert found.roughness is not None


def test_light_that_no_pass_holds_is_told() -> None:
    made = passes()
    made["Combined"][1, 1, 0] += 0.125
    assert maps_of(made).closure == pytest.approx(0.125, rel=1e-5)
