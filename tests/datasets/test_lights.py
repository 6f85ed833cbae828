"""Lights in other shapes than latitude-longitude are converted if the file states its layout, or refused by name."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import torch
from scipy.spatial.transform import Rotation

from radiogs_baselines.outputs.predictions import read_environment
from radiogs_core.errors import DataError
from radiogs_core.scene.light import EnvironmentMap, texel_directions
from radiogs_core.scene.placed_light import placed_light
from radiogs_datasets.image_files import write_exr, write_hdr
from radiogs_datasets.layouts import tensoir
from radiogs_datasets.lights import latitude_longitude, read_light

SIDE = 32


def radiance(directions: np.ndarray) -> np.ndarray:
    """A smooth radiance that differs in each direction of the world (Z up, +X ahead)."""
    x, y, z = np.moveaxis(directions / np.linalg.norm(directions, axis=-1, keepdims=True), -1, 0)
    return np.stack([2 + x + 0.5 * y * z, 2 + y - 0.4 * x * z, 2 + z + 0.3 * x * y], -1).astype(np.float32)


def steps(first: float, last: float) -> np.ndarray:
    return np.linspace(first, last, SIDE)


def openexr_cube() -> np.ndarray:
    """Faces +X, -X, +Y, -Y, +Z, -Z of OpenEXR's world (Y up, ahead +Z, left +X), as ImfEnvmap.h describes them."""
    rise, run = np.meshgrid(steps(1, -1), steps(-1, 1), indexing="ij")
    one = np.ones_like(rise)
    faces = [
        (one, rise, run),
        (-one, rise, -run),
        (run, one, rise),
        (run, -one, -rise),
        (-run, rise, one),
        (run, rise, -one),
    ]
    return np.concatenate([radiance(np.stack([z, x, y], -1)) for x, y, z in faces])


def looking(azimuth: float, pitch: float) -> np.ndarray:
    """The square picture with a right angle of view towards an azimuth, pitched up by so many degrees."""
    edge = 1 - 1 / SIDE
    rise, left = np.meshgrid(steps(edge, -edge), steps(edge, -edge), indexing="ij")
    ahead = np.stack([np.ones_like(rise), left, rise], -1)
    return radiance(ahead @ Rotation.from_euler("yz", [-pitch, azimuth], degrees=True).as_matrix().T)


def cross(rows: int, columns: int, faces: dict[tuple[int, int], np.ndarray]) -> np.ndarray:
    whole = np.zeros((rows, columns, SIDE, SIDE, 3), np.float32)
    for place, face in faces.items():
        whole[place] = face
    return whole.transpose(0, 2, 1, 3, 4).reshape(rows * SIDE, columns * SIDE, 3)


SHARED_FACES = {
    (1, 1): looking(0, 0),
    (1, 0): looking(90, 0),
    (1, 2): looking(-90, 0),
    (0, 1): looking(0, 90),
    (2, 1): looking(0, -90),
}


def vertical_cross() -> np.ndarray:
    return cross(4, 3, SHARED_FACES | {(3, 1): looking(0, -180)})


def horizontal_cross() -> np.ndarray:
    return cross(3, 4, SHARED_FACES | {(1, 3): looking(180, 0)})


def write_cube(path: Path, image: np.ndarray, envmap: object = OpenEXR.ENVMAP_CUBE) -> Path:
    channels = {name: np.ascontiguousarray(image[..., place]) for place, name in enumerate("RGB")}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "envmap": envmap}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))
    return path


def write_plain(path: Path, image: np.ndarray) -> Path:
    write_exr(path, image)
    return path


@pytest.mark.parametrize(
    ("image", "write", "said"),
    [
        (openexr_cube, write_cube, "envmap"),
        (vertical_cross, write_plain, "vertical cross"),
        (horizontal_cross, write_plain, "horizontal cross"),
    ],
)
def test_a_known_radiance_comes_back_from_a_cube_map(
    tmp_path: Path, image: Callable[[], np.ndarray], write: Callable[[Path, np.ndarray], Path], said: str
) -> None:
    light, sentences = read_light(write(tmp_path / "cube.exr", image()))
    assert light.radiance.shape == (2 * SIDE, 4 * SIDE, 3)
    expected = radiance(texel_directions(2 * SIDE, 4 * SIDE).numpy())
    assert float(np.abs(light.radiance.numpy() - expected).max()) < 0.02
    assert len(sentences) == 1
    assert said in sentences[0]


@pytest.mark.parametrize(
    ("shape", "why"),
    [
        ((64, 64), "angular map"),
        ((16, 96), "six faces of a cube in a strip"),
        ((96, 16), "six faces of a cube in a strip"),
        ((16, 64), "the upper half of the sphere alone"),
        ((64, 48), "its corners are not empty"),
        ((48, 64), "its corners are not empty"),
        ((40, 64), "Nothing in it says which direction a pixel shows"),
        ((32, 48), "Nothing in it says"),
        ((128, 64), "Nothing in it says"),
    ],
)
def test_a_light_in_another_shape_is_refused_by_name_wherever_it_is_read(
    tmp_path: Path, shape: tuple[int, int], why: str
) -> None:
    path = tmp_path / "light.hdr"
    write_hdr(path, np.random.default_rng(0).random((*shape, 3)) + 0.1)
    for read in (read_light, tensoir.read_light, read_environment):
        with pytest.raises(DataError, match=f"is {shape[1]} x {shape[0]} pixels: no latitude-longitude map") as found:
            read(path)
        assert why in found.value.why
        assert "Convert it" in found.value.remedy


def test_a_cube_map_of_another_size_and_latitude_longitude_by_attribute_are_told_apart(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).random((32, 64, 3)).astype(np.float32)
    with pytest.raises(DataError, match="64 x 32") as found:
        read_light(write_cube(tmp_path / "cube.exr", noise))
    assert "six times as high as wide" in found.value.why
    light, said = read_light(write_cube(tmp_path / "flat.exr", noise, OpenEXR.ENVMAP_LATLONG))
    assert (light.radiance.numpy() == noise).all()
    assert said == []


def test_the_same_light_from_everywhere_has_any_shape_and_odd_widths_are_taken() -> None:
    for shape in ((1, 1, 3), (8, 8, 3), (50, 101, 3), (50, 99, 3)):
        flat = torch.full(shape, 0.5) if shape[0] != 50 else torch.rand(shape)
        assert latitude_longitude("light", flat)[0] is flat


def turned(up: tuple[float, float, float], turn: float) -> tuple[torch.Tensor, np.ndarray]:
    stored = torch.from_numpy(radiance(texel_directions(64, 128).numpy()))
    light, _ = latitude_longitude("light", stored)
    stood, to_map = placed_light(EnvironmentMap(light), torch.tensor(up, dtype=torch.float64), turn)
    return stood.radiance, to_map.numpy()


@pytest.mark.parametrize("up", [(0.0, 0, 1), (0, -1, 0), (0, 2, 0), (1, 0, 0), (0, 0, -1), (0.3, -0.5, 0.6)])
def test_a_light_is_placed_in_the_world_with_its_top_up(up: tuple[float, float, float]) -> None:
    found, to_map = turned(up, 0.0)
    height, width = found.shape[:2]
    world = texel_directions(height, width).numpy()
    expected = radiance(world @ to_map.T)
    assert float(np.abs(found.numpy() - expected).max()) < 0.02  # a pole of a map has the value of its row
    assert to_map[2] == pytest.approx(np.array(up) / np.linalg.norm(up), abs=1e-12)
    assert to_map @ to_map.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(to_map) == pytest.approx(1)


def test_a_light_turns_counter_clockwise_seen_from_above_and_else_keeps_its_values() -> None:
    found, to_map = turned((0.0, 0.0, 1.0), 90.0)
    assert to_map[0] == pytest.approx([0, 1, 0], abs=1e-12)  # the centre column has turned from +X to +Y
    kept, _ = turned((0.0, 0.0, 1.0), 0.0)
    assert torch.equal(kept, torch.from_numpy(radiance(texel_directions(64, 128).numpy())))
    fine = kept.repeat_interleave(2, 0).repeat_interleave(2, 1).roll(-64, 1)  # a quarter of 256 columns
    assert float((found - fine).abs().max()) < 0.03
