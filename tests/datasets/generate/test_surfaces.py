"""The true surfaces of scenes: which scenes know them, and that samples lie on them and cover them once."""

import json
import math
import shutil
from pathlib import Path

import pytest
import torch

from radiogs_core.errors import DataError
from radiogs_core.scene.surfaces import SurfaceSamples
from radiogs_core.surfels.known_surfaces import surfels_on
from radiogs_datasets import load_scene, scene_choices, scene_kind
from radiogs_datasets.furnace import ALBEDOS, EMISSION, HALF_SIDE
from radiogs_datasets.generate.catalogue import RECIPES
from radiogs_datasets.hard_scenes import HARD_CASES
from radiogs_datasets.reduction import every, smaller
from radiogs_datasets.registry import TINY, forward_names, scene_names


@pytest.mark.slow
@pytest.mark.parametrize("name", [*scene_names(TINY), *forward_names()])
def test_every_generated_scene_knows_its_surfaces(name: str) -> None:
    samples = load_scene(name).true_surfaces(0.4)
    normal = samples.frame[..., 2]
    assert float((samples.frame.mT @ samples.frame - torch.eye(3).double()).abs().max()) < 1e-12
    assert float((torch.linalg.cross(samples.frame[..., 0], samples.frame[..., 1]) - normal).abs().max()) < 1e-12
    assert float(samples.size.max()) <= 0.4 * 1.001


def test_samples_of_a_ball_lie_on_it_and_cover_it_once() -> None:
    samples = load_scene("convex").true_surfaces(0.1)
    radius = samples.centre.norm(dim=-1)
    torch.testing.assert_close(radius, torch.ones_like(radius))
    torch.testing.assert_close(samples.frame[..., 2], samples.centre)
    assert float(samples.size.prod(-1).sum()) == pytest.approx(4 * math.pi, rel=1e-6)


def test_walls_of_a_furnace_face_inwards_emit_light_and_have_no_lobe() -> None:
    for name, albedo in ALBEDOS.items():
        samples = load_scene(name).true_surfaces(0.3)
        assert bool(((samples.centre * samples.frame[..., 2]).sum(-1) == -HALF_SIDE).all())
        assert samples.emission is not None
        assert bool((samples.emission == EMISSION).all())
        assert not samples.specular
        assert bool((samples.albedo == albedo).all())
        assert float(samples.size.prod(-1).sum()) == pytest.approx(6 * (2 * HALF_SIDE) ** 2)


def test_reduced_scenes_keep_their_true_surfaces() -> None:
    whole = load_scene("corner")
    for scene in (every(whole, 4), smaller(whole, 2)):
        assert torch.equal(scene.true_surfaces(0.3).centre, whole.true_surfaces(0.3).centre)


@pytest.mark.slow
def test_a_generated_scene_is_known_by_its_metadata_whatever_its_folder_is_called(tmp_path: Path) -> None:
    folder = tmp_path / "glossy"
    shutil.copytree(TINY / "convex", folder)
    found = load_scene(str(folder)).true_surfaces(0.3)
    assert torch.equal(found.centre, load_scene("convex").true_surfaces(0.3).centre)
    for strange in ("[1, 2", "[]", '{"scene": 3}', '{"scene": "kettle"}'):
        (folder / "metadata.json").write_text(strange)
        assert load_scene(str(folder)).surfaces is None
    (folder / "metadata.json").unlink()
    scene = load_scene(str(folder))
    assert scene.surfaces is None
    with pytest.raises(DataError, match="surfaces of scene 'glossy' are not known"):
        scene.true_surfaces(0.1)


def test_hard_cases_have_no_surfaces() -> None:
    assert load_scene(HARD_CASES).surfaces is None


@pytest.mark.parametrize("name", scene_names(TINY))
def test_metadata_of_the_miniatures_names_their_recipe(name: str) -> None:
    metadata = json.loads((TINY / name / "metadata.json").read_text())
    assert metadata["scene"] == name
    recipe = RECIPES[name]
    assert (metadata["purpose"], metadata["kind"], metadata["choices"]) == (recipe.purpose, recipe.kind, recipe.choices)


def test_a_scenes_kind_and_choices_are_read_by_its_name(tmp_path: Path) -> None:
    assert (scene_kind("niche"), scene_choices("niche")) == ("single effects", "tuned on")
    assert (scene_kind("lamps"), scene_choices("lamps")) == ("small lamps at night", "reported only")
    assert scene_kind("corner-128") == scene_kind("corner")
    folder = tmp_path / "mine"
    folder.mkdir()
    for written in ('{"kind": 3}', '["kind"]', '{"kind": "a\\u0000b"}', "{"):
        (folder / "metadata.json").write_text(written)
        assert scene_kind(str(folder)) is None
    (folder / "metadata.json").write_text('{"kind": "flowers"}')
    assert (scene_kind(str(folder)), scene_choices(str(folder))) == ("flowers", None)
    for other in ("furnace-0.5", HARD_CASES, "no such scene", "x" * 5000):
        assert scene_kind(other) is None


def test_surfels_have_the_materials_of_their_samples() -> None:
    samples = load_scene("corner").true_surfaces(0.3)
    surfels = surfels_on(samples)
    torch.testing.assert_close(surfels.albedo.double(), samples.albedo, atol=1e-6, rtol=1e-5)
    torch.testing.assert_close(surfels.roughness.double(), samples.roughness, atol=1e-6, rtol=1e-5)
    torch.testing.assert_close(surfels.frame.double(), samples.frame, atol=1e-6, rtol=0)
    assert {value.dtype for value in surfels.parameters().values()} == {torch.float32}


@pytest.mark.parametrize("changed", [{"albedo": torch.ones(1, 3)}, {"roughness": torch.tensor([0.05])}])
def test_materials_that_no_surfel_has_are_refused(changed: dict[str, torch.Tensor]) -> None:
    values = {
        "centre": torch.zeros(1, 3), "frame": torch.eye(3)[None], "size": torch.ones(1, 2),
        "albedo": torch.full((1, 3), 0.5), "roughness": torch.tensor([0.5]),
    }  # fmt: skip
    with pytest.raises(ValueError, match="no finite parameters"):
        surfels_on(SurfaceSamples(**values | changed))
