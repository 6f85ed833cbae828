"""Blender's renders agree with closed forms and with Mitsuba; skipped if one of them is not installed."""

import math
from pathlib import Path

import numpy as np
import pytest
import torch

from radiogs_core.scene.light import texel_directions
from radiogs_datasets import load_scene
from radiogs_datasets.blend.cameras import shots
from radiogs_datasets.blend.passes import Maps
from radiogs_datasets.blend.process import Blender
from radiogs_datasets.blend.request import Request
from radiogs_datasets.blend.scene_folder import write_lights, write_scene
from radiogs_datasets.blend.studio import Studio
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.probe import mitsuba_failure
from radiogs_datasets.generate.solids import Sphere

EXAMPLES = Path(__file__).parents[3] / "docs/examples"
with pytest.MonkeyPatch.context() as patched:
    patched.syspath_prepend(str(EXAMPLES))
    from cycles_against_mitsuba import FILES, Line, Part, compared, write_file

RADIUS, CENTRE, ALBEDO = 0.8, (0.1, -0.2, 0.3), (0.7, 0.4, 0.2)


def ball(specular: float = 0.0) -> tuple[Part, ...]:
    return (Part("ball", Sphere(CENTRE, RADIUS, Material(ALBEDO, 0.3, specular))),)


def taken(
    blender: Blender, parts: tuple[Part, ...], lights: Path, folder: Path, light: str = "training", **given: int
) -> tuple[Maps, Request]:
    """The maps of a view of these parts, written to a file and read again."""
    path = write_file(parts, folder / "scene.blend")
    request = Request(path, lights, **({"size": 48, "samples": 64, "bounces": 4} | given))  # type: ignore[arg-type]
    opened = blender.ask("open", file=str(path), device="cpu", threads=1)
    maps = folder / "envmaps"
    studio = Studio(blender, request, write_lights(request, maps, folder), folder / "picture.exr")
    shot = shots(request, opened["low"], opened["high"])[0]
    if light != "training":
        studio.take(shot)  # the light before must leave nothing behind
    return studio.take(shot, light), request


def seen_ball(request: Request) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where rays through the middles of pixels meet the ball: whether, z-depth, normal."""
    shot = shots(request, [-1.0] * 3, [1.0] * 3)[0]
    camera, size = shot.camera, request.size
    row, column = np.mgrid[:size, :size] + 0.5
    local = np.stack([(column - size / 2) / camera.fx, (row - size / 2) / camera.fy, np.ones((size, size))], -1)
    pose = camera.camera_to_world.double().numpy()
    ray = local @ pose[:3, :3].T
    offset = pose[:3, 3] - np.array(CENTRE)
    a, b, c = (ray**2).sum(-1), (ray * offset).sum(-1), float((offset**2).sum()) - RADIUS**2
    inside = b**2 - a * c
    depth = (-b - np.sqrt(np.maximum(inside, 0))) / a
    return inside > 0, depth, (offset + depth[..., None] * ray) / RADIUS


def test_a_white_ball_in_a_white_furnace_shows_its_albedo_and_its_shape(
    blender: Blender, lights: Path, tmp_path: Path
) -> None:
    maps, request = taken(blender, ball(), lights, tmp_path)
    met, depth, normal = seen_ball(request)
    whole = (maps.alpha[..., 0] > 0.999) & met
    assert whole.mean() > 0.1
    assert not (maps.alpha[..., 0] > 0)[~met].all()
    assert np.abs(maps.image[whole] - ALBEDO).max() < 0.05
    assert np.abs(maps.image[whole].mean(0) - ALBEDO).max() < 0.003
    assert np.abs(maps.albedo[whole] - ALBEDO).max() < 1e-5
    assert float(np.abs(maps.indirect).max()) < 1e-6
    assert maps.closure < 1e-5
    # Within a pixel the shape bends; at its rim more than in its middle.
    middle = whole & (
        np.abs(normal @ (np.array(CENTRE) - shots(request, [-1.0] * 3, [1.0] * 3)[0].camera.centre.numpy())) > 2.5
    )
    assert np.abs(maps.depth[..., 0] - depth)[middle].max() < 0.01
    assert np.degrees(np.arccos((maps.normal * normal).sum(-1)[middle].clip(-1, 1))).max() < 2
    assert {name for name, weight in maps.features.items() if weight.any()} == {"no_specular"}


def test_the_brightest_side_faces_the_bright_texel(blender: Blender, lights: Path, tmp_path: Path) -> None:
    maps, request = taken(blender, ball(), lights, tmp_path, "spot", samples=256)
    texel = texel_directions(16, 32)[4, 10].numpy()
    met, _, normal = seen_ball(request)
    whole = (maps.alpha[..., 0] > 0.999) & met
    shade, wanted = maps.image[..., 1][whole], np.maximum(normal[whole] @ texel, 0)
    assert wanted.max() > 0.9
    assert np.corrcoef(shade, wanted)[0, 1] > 0.998
    # The texel's irradiance, by its solid angle, over pi.
    texels = torch.pi / 16 * 2 * torch.pi / 32 * math.cos(math.asin(float(texel[2])))
    peak = 128 * float(texels) * ALBEDO[1] / math.pi
    assert shade[wanted > 0.98].mean() == pytest.approx(0.99 * peak, rel=0.05)


def test_a_dielectric_is_read_from_its_principled_material(blender: Blender, lights: Path, tmp_path: Path) -> None:
    maps, _ = taken(blender, ball(specular=1.0), lights, tmp_path, size=24, samples=16)
    whole = maps.alpha[..., 0] > 0.999
    assert maps.roughness[whole] == pytest.approx(0.3, abs=1e-5)
    assert maps.albedo[whole].mean(0).tolist() == pytest.approx(ALBEDO, abs=1e-5)
    assert not any(weight.any() for weight in maps.features.values())


def test_bounces_are_cut_and_deeper_ones_add_light(blender: Blender, lights: Path, tmp_path: Path) -> None:
    parts = FILES["solids"]
    sums = [
        float(taken(blender, parts, lights, tmp_path, bounces=bounces, size=16)[0].indirect.sum())
        for bounces in (0, 1, 6)
    ]
    assert sums[0] == 0
    assert 0 < sums[1] < 0.95 * sums[2]


def test_a_scene_is_made_from_a_file_by_two_processes(blender: Blender, lights: Path, tmp_path: Path) -> None:
    path = write_file(FILES["copies"], tmp_path / "copies.blend")
    told: list[int] = []
    request = Request(path, lights, train=3, test=1, size=16, samples=4)
    found = write_scene(request, tmp_path / "made", 2, 1, lambda done, total: told.append(done))
    assert told == [1, 2, 3, 4]
    scene = load_scene(str(tmp_path / "made"))
    assert (len(scene.train), len(scene.test)) == (3, 1)
    assert found["opened"]["instances"] == 3
    assert 0.01 < found["indirect_share"] < 0.5


@pytest.mark.parametrize("name", ["solids", "checked", "copies"])
def test_cycles_and_mitsuba_agree_within_their_noise(blender: Blender, name: str) -> None:
    failure = mitsuba_failure()
    if failure is not None:
        pytest.skip(f"Mitsuba cannot render here: {failure}")
    lines = [line for line in compared([name], 48, 256) if isinstance(line, Line)]
    assert len(lines) == 14
    for line in lines:
        if line.name in ("alpha", "image", "direct", "indirect"):
            assert line.measured > line.expected - 2, line
            assert abs(line.bias) < (0.04 if line.name == "indirect" else 0.01), line
        else:
            # Surfaces are averages over few random samples here, and over many exact hits there.
            assert line.measured > 30, line
            assert abs(line.bias) < 0.01, line
