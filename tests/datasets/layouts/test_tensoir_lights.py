"""Environment maps are found where TensoIR's scenes keep them, in the orientation of their convention."""

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from radiogs_core.errors import DataError
from radiogs_datasets import load_scene
from radiogs_datasets.image_files import write_hdr
from radiogs_datasets.layouts.tensoir import find_lights, read_light
from radiogs_datasets.registry import TINY


@pytest.mark.parametrize(("row", "column"), [(0, 0), (5, 3), (8, 16), (11, 27), (15, 31)])
def test_a_single_bright_texel_lights_its_own_direction(tmp_path: Path, row: int, column: int) -> None:
    radiance = np.zeros((16, 32, 3))
    radiance[row, column] = (8.0, 4.0, 2.0)
    write_hdr(tmp_path / "a.hdr", radiance)
    azimuth = math.pi - 2 * math.pi * (column + 0.5) / 32
    elevation = math.pi / 2 - math.pi * (row + 0.5) / 16
    direction = torch.tensor(
        [math.cos(elevation) * math.cos(azimuth), math.cos(elevation) * math.sin(azimuth), math.sin(elevation)]
    )
    light = read_light(tmp_path / "a.hdr")
    torch.testing.assert_close(light.lookup(direction), torch.tensor([8.0, 4.0, 2.0]), rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(light.lookup(-direction), torch.zeros(3), rtol=0, atol=1e-4)


@pytest.mark.parametrize("above", [".", ".."])
def test_maps_of_the_archive_are_found_beside_the_scenes_or_one_level_up(tmp_path: Path, above: str) -> None:
    folder = tmp_path / "scenes" / "lego"
    shutil.copytree(TINY / "corner", folder)
    shutil.rmtree(folder / "envmaps")
    for resolution, brightness in (("1k", 1.0), ("2k", 2.0)):
        archive = tmp_path / "scenes" / above / "Environment_Maps" / f"high_res_envmaps_{resolution}"
        archive.mkdir(parents=True)
        for light in ("sunset", "overcast", "museum"):
            write_hdr(archive / f"{light}.hdr", np.full((16, 32, 3), brightness))
    scene = load_scene(str(folder))
    assert set(scene.lights) == {"sunset", "overcast"}  # the lights that test images show
    assert float(scene.lights["overcast"].radiance.mean()) == 2  # ground truth was rendered under the 2k maps
    assert scene.training_light is not None


def test_a_scene_without_any_map_is_good_for_all_but_relighting(tmp_path: Path) -> None:
    assert find_lights(tmp_path, {"sunset"}) == {}


def sharing(tmp_path: Path, lights: object) -> Path:
    """A scene that names maps of its set, which has one called ``sky``."""
    folder = tmp_path / "set" / "corner"
    shutil.copytree(TINY / "corner", folder)
    shutil.move(folder / "envmaps", folder.parent / "lights")
    (folder / "lights.json").write_text(json.dumps(lights))
    return folder


def test_scenes_share_the_maps_of_their_set_each_turned_by_columns(tmp_path: Path) -> None:
    """By a quarter of the columns to the right: the sun stands a quarter of the circle nearer to where columns end."""
    entries = {name: {"map": name, "turned": 0} for name in ("training", "sunset", "overcast")}
    folder = sharing(tmp_path, entries | {"sunset": {"map": "training", "turned": 16}})
    scene = load_scene(str(folder))
    own = load_scene("corner")
    assert own.training_light is not None
    assert scene.training_light is not None
    assert torch.equal(scene.training_light.radiance, own.training_light.radiance)
    assert set(scene.lights) == {"sunset", "overcast"}
    assert torch.equal(scene.lights["sunset"].radiance[:, 16:], own.training_light.radiance[:, :-16])
    row, column = divmod(int(own.training_light.radiance.sum(-1).argmax()), 64)
    azimuth, elevation = math.pi * (1 - (column + 16.5) / 32), math.pi * (0.5 - (row + 0.5) / 32)
    flat = math.cos(elevation)
    sun = torch.tensor([flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)])
    shown = scene.lights["sunset"].lookup(sun)
    torch.testing.assert_close(shown, own.training_light.radiance[row, column], rtol=1e-4, atol=1e-4)
    text = (folder / "lights.json").read_text().replace("16", "17")
    (folder / "lights.json").write_text(text)
    assert load_scene(str(folder)).checksum != scene.checksum


@pytest.mark.parametrize(
    ("lights", "told"),
    [
        ([1], "names no map"),
        ({"training": {"map": "../corner/train_000/rgba", "turned": 0}}, "nothing outside that is read"),
        ({"training": {"map": "training", "turned": 1.5}}, "names no map"),
        ({"training": {"map": "training"}}, "names no map"),
        ({"training": {"map": "training", "turned": 0}}, "no environment map for: overcast, sunset"),
        ({name: {"map": "mars", "turned": 0} for name in ("sunset", "overcast")}, "mars.hdr"),
    ],
)  # fmt: skip
def test_a_table_of_shared_maps_that_names_none_is_an_error(tmp_path: Path, lights: object, told: str) -> None:
    with pytest.raises(DataError, match=told):
        load_scene(str(sharing(tmp_path, lights)))
