"""Renders of Blender become maps; its cameras and lights are the scene's."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch

from datasets.blend.multilayer import passes, write_multilayer
from radiogs_core.errors import DataError
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import View
from radiogs_datasets.blend.cameras import RADIUS, shots
from radiogs_datasets.blend.passes import maps_of, read_passes
from radiogs_datasets.blend.request import Request
from radiogs_datasets.blend.studio import ROWS, refined
from radiogs_datasets.cameras.transforms import read_transforms
from radiogs_datasets.writing import opengl, write_transforms


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


def test_other_files_than_pictures_are_an_error(tmp_path: Path) -> None:
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


def test_maps_are_zero_without_coverage() -> None:
    found = maps_of(passes(4, 0.0))
    for name in ("image", "alpha", "direct", "indirect", "incident_indirect", "albedo", "normal", "depth"):
        assert not getattr(found, name).any(), name
    assert found.roughness is not None


def test_light_missing_from_the_passes_shows_in_closure() -> None:
    made = passes()
    made["Combined"][1, 1, 0] += 0.125
    assert maps_of(made).closure == pytest.approx(0.125, rel=1e-5)


def test_a_refined_map_is_looked_up_as_the_map_itself() -> None:
    light = np.random.default_rng(0).random((16, 32, 3)).astype(np.float32)
    fine = refined(light)
    assert fine.shape == (16 * 31, 32 * 31, 3)
    directions = torch.nn.functional.normalize(
        torch.from_numpy(np.random.default_rng(1).normal(size=(5000, 3))), dim=-1
    )
    found, wanted = (EnvironmentMap(torch.from_numpy(each)).lookup(directions.float()) for each in (fine, light))
    assert float((found - wanted).abs().max()) < 2e-4


def test_a_fine_map_stays_as_it_is() -> None:
    light = np.random.default_rng(0).random((ROWS, 8, 3)).astype(np.float32)
    assert np.array_equal(refined(light), light)


def test_rows_end_at_the_poles_and_columns_wrap() -> None:
    light = np.zeros((16, 32, 1), np.float32)
    light[0], light[8, 0] = 1, 1
    fine = refined(light)
    assert (fine[0] == 1).all()
    assert not fine[-1].any()
    assert fine[8 * 31 + 15, -1] > 0
    assert fine[8 * 31 + 15, 47] == 0


def asked(cameras: str = "published", **given: int) -> Request:
    return Request(Path("scene.blend"), Path("lights"), cameras=cameras, **given)  # type: ignore[arg-type]


def test_published_cameras_stand_on_the_sphere_and_look_at_the_origin_from_above() -> None:
    found = shots(asked(train=40, test=10), [-1.0] * 3, [1.0] * 3)
    assert [shot.split for shot in found] == ["train"] * 40 + ["test"] * 10
    assert len({shot.name for shot in found}) == 50
    centres = torch.stack([shot.camera.centre for shot in found])
    assert centres.norm(dim=-1).tolist() == pytest.approx([RADIUS] * 50, rel=1e-5)
    assert (centres[:, 2] > 0).all()
    for shot in found:
        assert torch.allclose(shot.camera.axes[:, 2], -shot.camera.centre / RADIUS, atol=1e-5)
        assert shot.field_of_view == pytest.approx(0.6911112, rel=1e-6)
        # Blender looks along its own -z.
        assert [-row[2] for row in opengl(shot.camera)[:3]] == pytest.approx(shot.camera.axes[:, 2].tolist(), abs=1e-6)
    apart = (centres[:, None] - centres).norm(dim=-1) + 10 * torch.eye(50)
    assert float(apart.min()) > 0.2


@pytest.mark.parametrize(
    ("low", "high"), [([-900.0, -500.0, 0.0], [900.0, 500.0, 700.0]), ([-0.01] * 3, [0.01] * 3), ([4.0] * 3, [5.0] * 3)]
)
def test_a_scene_that_published_cameras_do_not_see_is_refused_with_its_measures(
    low: list[float], high: list[float]
) -> None:
    with pytest.raises(DataError, match=f"measures {high[0] - low[0]:.4g} x .*") as caught:
        shots(asked(), low, high)
    assert "--cameras fit" in str(caught.value)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_fitted_cameras_see_the_whole_box_at_any_scale(scale: float) -> None:
    low, high = [scale * each for each in (3.0, -2.0, 5.0)], [scale * each for each in (5.0, -1.0, 5.5)]
    corners = torch.tensor(
        [[x, y, z, 1] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    )
    for shot in shots(asked("fit", train=20, test=5, size=100), low, high):
        seen = torch.linalg.inv(shot.camera.camera_to_world.double()) @ corners.double().T
        pixel = shot.camera.fx * seen[:2] / seen[2] + 50
        assert (seen[2] > 0).all()
        assert bool(((pixel > 0) & (pixel < 100)).all())
        assert shot.distance == pytest.approx(float(seen[2].mean()), rel=0.5)


def test_a_single_point_has_no_cameras() -> None:
    with pytest.raises(DataError, match="single point"):
        shots(asked("fit"), [1.0] * 3, [1.0] * 3)


def test_cameras_of_transforms_files_are_taken_as_they_are(tmp_path: Path) -> None:
    given = shots(asked(train=3, test=2, size=64), [-1.0] * 3, [1.0] * 3)
    for split in ("train", "test"):
        of_split = [View(shot.name, shot.camera, {}) for shot in given if shot.split == split]
        write_transforms(tmp_path / f"transforms_{split}.json", of_split, ["x"] * len(of_split))
    found = shots(asked(str(tmp_path), size=32), [-1.0] * 3, [1.0] * 3)
    assert [shot.name for shot in found] == [shot.name for shot in given]
    for one, other in zip(found, given, strict=True):
        assert torch.allclose(one.camera.camera_to_world, other.camera.camera_to_world, atol=1e-6)
        assert one.field_of_view == pytest.approx(other.field_of_view)
        assert one.camera.width == 32


def test_a_camera_that_is_no_square_pinhole_is_refused(tmp_path: Path) -> None:
    frame = {"file_path": "a", "transform_matrix": torch.eye(4).tolist()}
    table = {"camera_angle_x": 0.7, "camera_angle_y": 0.5, "frames": [frame]}
    for split in ("train", "test"):
        (tmp_path / f"transforms_{split}.json").write_text(json.dumps(table))
    assert math.isfinite(
        read_transforms(tmp_path / "transforms_train.json")
        .camera(read_transforms(tmp_path / "transforms_train.json").frames[0], 8, 8)
        .fy
    )
    with pytest.raises(DataError, match="no square pinhole"):
        shots(asked(str(tmp_path)), [-1.0] * 3, [1.0] * 3)
