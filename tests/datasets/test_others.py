"""The scenes by other hands: complete, clean of noise, credited, and by another renderer, materials and lights."""

import hashlib
import json
from pathlib import Path

import pytest
import torch

from radiogs_core.scene.scene import Scene
from radiogs_datasets import load_scene, scene_choices, scene_names
from radiogs_datasets.data_root import OTHERS
from radiogs_datasets.image_files import write_hdr

ROOT = Path(__file__).parents[2]
NOTICE, DOCUMENT, BLENDER = (
    (ROOT / name).read_text(encoding="utf-8")
    for name in ("NOTICE", "docs/datasets.md", "docs/notebook/2026-11-30-blender.md")
)


@pytest.fixture(scope="module", params=scene_names(OTHERS))
def scene(request: pytest.FixtureRequest) -> Scene:
    return load_scene(request.param)


def told(scene: Scene) -> dict:
    return json.loads((OTHERS / scene.name / "metadata.json").read_text())


def test_six_of_the_ten_scenes_are_only_reported_and_all_of_them_are_small() -> None:
    names = scene_names(OTHERS)
    assert [scene_choices(name) for name in names].count("reported only") == 6
    assert len(names) == 10
    assert sum(path.stat().st_size for path in OTHERS.rglob("*") if path.is_file()) < 15_000_000


def test_a_scene_by_other_hands_has_every_map_and_two_more_lights(scene: Scene) -> None:
    assert (len(scene.train), len(scene.test)) == (40, 6)
    assert len(scene.lights) == 2
    assert scene.training_light is not None
    assert not any(torch.equal(light.radiance, scene.training_light.radiance) for light in scene.lights.values())
    maps = {"image", "alpha", "albedo", "normal", "roughness", "depth", "direct", "indirect"}
    assert set(scene.test[0].sources) == maps | {f"relit/{x}{part}" for x in scene.lights for part in ("", "/indirect")}
    assert not scene.repairs


def test_noise_lies_below_the_error_of_methods(scene: Scene) -> None:
    floors = told(scene)["noise_floors_db"]
    assert told(scene)["noise_floor_db"] >= 42
    assert floors["indirect"] >= 40
    assert told(scene)["bounces"] >= 32
    assert abs(told(scene)["energy_beyond_bounces"]) < 1e-3


def test_materials_vary_and_lights_reach_from_soft_to_sharp(scene: Scene) -> None:
    """No scene has few paints; the share of indirect light lies between 0.02 and 0.3."""
    view = scene.test[0]
    inside = view.read("alpha")[..., 0] == 1
    albedo, roughness = view.read("albedo")[inside], view.read("roughness")[inside]
    assert len(torch.unique((albedo * 32).round(), dim=0)) > 40
    assert float(roughness.std()) > 0.04
    assert 0.02 <= told(scene)["indirect_share"] <= 0.3


def test_direct_and_indirect_light_add_up_to_the_image(scene: Scene) -> None:
    view = scene.test[0]
    linear = view.read("direct") + view.read("indirect")
    shown = torch.where(linear < 0.0031308, 12.92 * linear, 1.055 * linear.clamp(min=1e-8) ** (1 / 2.4) - 0.055)
    error = (shown.clamp(0, 1) - view.read("image") * view.read("alpha")).abs()[view.read("alpha")[..., 0] == 1]
    assert float(error.mean()) < 0.004


def test_lights_are_the_maps_that_the_scene_was_rendered_under(scene: Scene, tmp_path: Path) -> None:
    """By their digests: each is a map of the set, turned by the columns that ``lights.json`` names."""
    assert scene.training_light is not None
    for name, light in {**scene.lights, "training": scene.training_light}.items():
        write_hdr(tmp_path / "light.hdr", light.radiance.numpy())
        assert hashlib.sha256((tmp_path / "light.hdr").read_bytes()).hexdigest() == told(scene)["lights"][name]


def test_makers_are_named_and_unrepresentable_materials_marked(scene: Scene) -> None:
    metadata = told(scene)
    assert metadata["maker"] == "other hands"
    for credit in metadata["credits"]:
        assert credit["licence"] in ("public domain", "CC0", "CC BY 4.0", "CC BY 3.0")
        assert credit["author"] in NOTICE
    beyond = {name for name, share in metadata["energy_of_what_the_brdf_cannot_say"].items() if share > 0.02}
    assert bool(beyond) == ("not_represented" in metadata)
    assert metadata.get("not_represented", "") == {"boot": "a clear coat", "hammer": "a metallic part"}.get(
        scene.name, ""
    )


def test_the_document_has_what_the_metadata_has(scene: Scene) -> None:
    metadata = told(scene)
    [row] = [line for line in DOCUMENT.splitlines() if line.startswith(f"| `{scene.name}` | {metadata['kind']}")]
    floors = (metadata["noise_floor_db"], metadata["noise_floors_db"]["indirect"])
    suns = [float(sun.split()[3]) for light, sun in metadata["suns"].items() if light == metadata["training_light"]]
    shown = [f"{100 * metadata['indirect_share']:.1f} %", *(f"{floor:.1f} dB" for floor in floors)]
    shown += [metadata["choices"], metadata["training_light"]]
    shown += [f"({across:g} degrees" for across in suns]
    assert all(value in row for value in shown)
    assert all(credit["author"] in row for credit in metadata["credits"] if credit["licence"] != "CC0")


def test_the_difference_of_principled_is_the_measured_one() -> None:
    table = [line for line in BLENDER.splitlines() if line.startswith("| dielectric |")]
    for less, more in (("1.60", "4.81"), ("2.34", "7.45")):
        assert any(f"-{less} %" in line and f"+{more} %" in line for line in table)
        assert less in DOCUMENT
        assert more in DOCUMENT


def test_four_training_lights_have_a_sun() -> None:
    """More than a fifth of the light comes from within three degrees of the brightest direction."""
    sunny = 0
    for name in scene_names(OTHERS):
        light = load_scene(name).training_light
        assert light is not None
        rows, columns = light.radiance.shape[:2]
        height = torch.sin((torch.arange(rows) + 0.5) / rows * torch.pi)
        energy = light.radiance.mean(-1) * height[:, None]
        row, column = divmod(int(light.radiance.mean(-1).argmax()), columns)
        near = energy.roll(columns // 2 - column, 1)[max(0, row - 4) : row + 5, columns // 2 - 5 : columns // 2 + 6]
        sunny += float(near.sum() / energy.sum()) > 0.2
    assert sunny >= 4
