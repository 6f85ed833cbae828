"""Files for other programs have their attributes and no others; a turned world looks the same to who turns along."""

import math
from pathlib import Path

import pytest
import torch
from plyfile import PlyData
from torch.nn.functional import normalize

from radiogs_core.kernels.surfel.footprint import frames
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.surfels.harmonics import CONSTANT_BASIS, surfel_radiance
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.surfels.viewer_files import FORMS, turned, upright, write_for_viewer

UP = torch.tensor([0.0, 0.0, 1.0])


def some_surfels() -> Surfels:
    generator = torch.Generator().manual_seed(5)
    shapes = {
        "centre": (6, 3), "rotation": (6, 4), "log_scale": (6, 2), "opacity_logit": (6,), "sh": (6, 16, 3),
        "albedo_logit": (6, 3), "roughness_logit": (6,),
    }  # fmt: skip
    return Surfels.of({name: torch.randn(shape, generator=generator) for name, shape in shapes.items()})


def columns(form: str, surfels: Surfels, path: Path) -> dict[str, torch.Tensor]:
    write_for_viewer(surfels, form, UP, path)
    rows = PlyData.read(str(path))["vertex"].data
    return {name: torch.from_numpy(rows[name].astype("f8")) for name in rows.dtype.names}


@pytest.mark.parametrize("form", FORMS)
def test_the_attributes_are_those_of_the_program_in_its_order(form: str, tmp_path: Path) -> None:
    """3DGS: ``construct_list_of_attributes`` of its gaussian_model.py; 2DGS: the same with two scales."""
    scales = 2 if form == "2dgs-ply" else 3
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    names += [f"f_rest_{place}" for place in range(45)]
    names += ["opacity", *(f"scale_{axis}" for axis in range(scales)), "rot_0", "rot_1", "rot_2", "rot_3"]
    assert list(columns(form, some_surfels(), tmp_path / "s.ply")) == names


@pytest.mark.parametrize("form", FORMS)
def test_colours_are_in_display_srgb(form: str, tmp_path: Path) -> None:
    surfels = some_surfels()
    linear = torch.tensor([0.8, 0.214, 0.01])
    surfels.sh.zero_()
    surfels.sh[:, 0] = (linear - 0.5) / CONSTANT_BASIS
    found = columns(form, surfels, tmp_path / "s.ply")
    for channel, shown in enumerate(srgb_encode(linear).tolist()):
        assert (0.5 + CONSTANT_BASIS * found[f"f_dc_{channel}"]).tolist() == pytest.approx([shown] * 6, abs=1e-5)


def test_a_surfel_is_flat_where_a_third_scale_is_told(tmp_path: Path) -> None:
    surfels = some_surfels()
    found = columns("3dgs-ply", surfels, tmp_path / "s.ply")
    assert found["scale_2"].tolist() == pytest.approx((surfels.log_scale.amin(-1) + math.log(1e-3)).tolist())
    for axis in range(2):
        assert found[f"scale_{axis}"].tolist() == pytest.approx(surfels.log_scale[:, axis].tolist())


def test_in_supersplat_the_scene_stands_upright(tmp_path: Path) -> None:
    """SuperSplat shows (-x, -y, z) of a PLY file with Y up: its up is the file's -Y, which has to be the scene's Z."""
    surfels = some_surfels()
    found = columns("supersplat", surfels, tmp_path / "s.ply")
    shown_up = -found["y"]
    assert shown_up.tolist() == pytest.approx(surfels.centre[:, 2].tolist(), abs=1e-6)
    assert (-found["ny"]).tolist() == pytest.approx(surfels.frame[:, 2, 2].tolist(), abs=1e-6)


@pytest.mark.parametrize("up", [[0.0, 0.0, 1.0], [0.3, -0.8, 0.5], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
def test_the_shortest_turn_brings_up_where_it_is_wanted(up: list[float]) -> None:
    start, end = torch.tensor(up), torch.tensor([0.0, -1.0, 0.0])
    by = frames(upright(start, end)[None])[0]
    torch.testing.assert_close(by @ normalize(start.double(), dim=0), end.double(), atol=1e-12, rtol=0)
    torch.testing.assert_close(by @ by.T, torch.eye(3).double(), atol=1e-12, rtol=0)
    assert float(torch.linalg.det(by)) == pytest.approx(1.0)


def test_a_turned_world_looks_the_same_to_who_turns_along() -> None:
    surfels = some_surfels()
    turn = normalize(torch.tensor([0.9, 0.2, -0.5, 0.3]).double(), dim=0)
    by, after = frames(turn[None])[0].float(), turned(surfels, turn)
    directions = normalize(torch.randn(6, 50, 3, generator=torch.Generator().manual_seed(1)), dim=-1)
    before, now = surfel_radiance(surfels.sh, directions), surfel_radiance(after.sh, directions @ by.T)
    torch.testing.assert_close(now, before, atol=2e-5, rtol=0)
    torch.testing.assert_close(after.frame, by @ surfels.frame, atol=1e-5, rtol=0)
    torch.testing.assert_close(after.centre, surfels.centre @ by.T)
    assert float((surfel_radiance(after.sh, directions) - before).abs().mean()) > 0.1, "the turn is seen"
