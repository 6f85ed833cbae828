"""Where the cameras of a rendered .blend file stand."""

import json
import math
from pathlib import Path

import pytest
import torch

from radiogs_core.errors import DataError
from radiogs_datasets.blend.cameras import RADIUS, shots
from radiogs_datasets.blend.request import Request
from radiogs_datasets.cameras.transforms import read_transforms
from radiogs_datasets.writing import write_transforms


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
        assert [-row[2] for row in shot.opengl()[:3]] == pytest.approx(shot.camera.axes[:, 2].tolist(), abs=1e-6)
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
        of_split = [shot for shot in given if shot.split == split]
        write_transforms(
            tmp_path / f"transforms_{split}.json", [shot.view() for shot in of_split], ["x"] * len(of_split)
        )
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
