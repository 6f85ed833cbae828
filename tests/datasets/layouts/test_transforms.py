"""Cameras of a transforms file project known points onto their pixels."""

import json
import math
from pathlib import Path

import pytest
import torch

from radiogs_datasets.cameras.transforms import read_transforms

ANGLE = math.radians(40)


def project(matrix: list[list[float]], point: list[float], size: int) -> tuple[float, float]:
    """OpenGL by the book: into the camera, looking along -z, y up, then to pixels from the top left corner."""
    inverse = torch.linalg.inv(torch.tensor(matrix, dtype=torch.float64))
    x, y, z = (inverse @ torch.tensor([*point, 1.0], dtype=torch.float64))[:3].tolist()
    scale = 0.5 * size / math.tan(ANGLE / 2)
    return size / 2 + scale * x / -z, size / 2 - scale * y / -z


@pytest.mark.parametrize("turn", [0.0, 0.7, 2.5])
def test_points_land_on_the_pixels_that_opengl_puts_them_on(tmp_path: Path, turn: float) -> None:
    c, s = math.cos(turn), math.sin(turn)
    matrix = [[c, -0.6 * s, 0.8 * s, 3 * s], [s, 0.6 * c, -0.8 * c, -3 * c], [0, 0.8, 0.6, 2.2], [0, 0, 0, 1]]
    table = {"camera_angle_x": ANGLE, "frames": [{"file_path": "./train_000/rgba", "transform_matrix": matrix}]}
    (tmp_path / "t.json").write_text(json.dumps(table))
    transforms = read_transforms(tmp_path / "t.json")
    camera = transforms.camera(transforms.frames[0], 80, 80)
    for point in ([0.0, 0.0, 0.0], [0.4, -0.3, 0.2], [-0.5, 0.1, 0.3]):
        x, y, z = (camera.axes.T @ (torch.tensor(point) - camera.centre)).tolist()
        seen = (camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy)
        assert seen == pytest.approx(project(matrix, point, 80), abs=1e-3)
        assert float(camera.depth_of(torch.tensor(point))) == pytest.approx(z, rel=1e-5)
        assert z > 0


def test_a_byte_order_mark_and_integers_are_read(tmp_path: Path) -> None:
    matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]
    table = {"camera_angle_x": 1, "frames": [{"file_path": "a/b", "transform_matrix": matrix, "rotation": 0.1}]}
    (tmp_path / "t.json").write_text(json.dumps(table), encoding="utf-8-sig")
    transforms = read_transforms(tmp_path / "t.json")
    assert transforms.camera(transforms.frames[0], 10, 20).fx == pytest.approx(10 / math.tan(0.5))
    torch.testing.assert_close(transforms.frames[0].camera_to_world.diag(), torch.tensor([1.0, -1.0, -1.0, 1.0]))
