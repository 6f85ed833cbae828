"""Surfels come back from a PLY file bit for bit, under the names that 3DGS gave them."""

from pathlib import Path

import pytest
import torch
from plyfile import PlyData

from radiogs_core.errors import DataError
from radiogs_core.surfels.ply import read_ply, write_ply
from radiogs_core.surfels.surfels import Surfels


def some_surfels() -> Surfels:
    generator = torch.Generator().manual_seed(3)
    shapes = {
        "centre": (7, 3), "rotation": (7, 4), "log_scale": (7, 2), "opacity_logit": (7,), "sh": (7, 16, 3),
        "albedo_logit": (7, 3), "roughness_logit": (7,),
    }  # fmt: skip
    return Surfels.of({name: torch.randn(shape, generator=generator) for name, shape in shapes.items()})


def test_every_parameter_comes_back_bit_for_bit(tmp_path: Path) -> None:
    surfels = some_surfels()
    write_ply(surfels, tmp_path / "s.ply")
    found = read_ply(tmp_path / "s.ply").parameters()
    for name, value in surfels.parameters().items():
        assert torch.equal(found[name], value), name


def test_fields_are_those_of_3dgs(tmp_path: Path) -> None:
    """f_rest holds fifteen coefficients of red, then of green, then of blue; the normal is the third column."""
    surfels = some_surfels()
    write_ply(surfels, tmp_path / "s.ply")
    rows = PlyData.read(str(tmp_path / "s.ply"))["vertex"].data
    assert float(rows["x"][2]) == float(surfels.centre[2, 0])
    assert float(rows["f_dc_1"][2]) == float(surfels.sh[2, 0, 1])
    assert float(rows["f_rest_0"][2]) == float(surfels.sh[2, 1, 0])
    assert float(rows["f_rest_15"][2]) == float(surfels.sh[2, 1, 1])
    assert float(rows["f_rest_44"][2]) == float(surfels.sh[2, 15, 2])
    assert float(rows["rot_0"][2]) == float(surfels.rotation[2, 0])
    w, x, y, z = torch.nn.functional.normalize(surfels.rotation[2].double(), dim=0).tolist()
    assert float(rows["nx"][2]) == pytest.approx(2 * (x * z + w * y), abs=1e-6)


def test_what_is_no_file_of_surfels_is_a_data_error(tmp_path: Path) -> None:
    (tmp_path / "text.ply").write_text("hello")
    for path in (tmp_path / "text.ply", tmp_path / "absent.ply"):
        with pytest.raises(DataError, match="no PLY file"):
            read_ply(path)
    points = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0\n"
    (tmp_path / "points.ply").write_text(points)
    with pytest.raises(DataError, match="lacks y, z"):
        read_ply(tmp_path / "points.ply")
