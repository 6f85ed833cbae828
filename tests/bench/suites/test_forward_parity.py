"""The comparison with the path tracer: quantities, pixels, and a small run."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from radiogs.method import RADIOGS
from radiogs.settings import PRESETS, Variant
from radiogs_bench.methods import method
from radiogs_bench.runs.cell import Work, cell_of
from radiogs_bench.runs.forward_parity import MARGIN, clear_of_silhouettes, compared, run_forward_parity
from radiogs_bench.runs.interruption import Interruption
from radiogs_bench.runs.progress import LogProgress
from radiogs_bench.runs.scene_checksum import checksum_now
from radiogs_bench.runs.stages import Bench
from radiogs_bench.store.folder import Store
from radiogs_core.errors import DataError
from radiogs_core.learning.known_scene import known_scene
from radiogs_core.transport.splatting import SOLID_ALPHA
from radiogs_datasets import load_scene
from radiogs_datasets.registry import FORWARD, forward_names

CPU = torch.device("cpu")
SCENES = ("corner-128", "red_white-128", "bowl-128")


def test_equal_images_have_no_bias_and_twice_the_light_has_a_hundred_per_cent() -> None:
    generator = torch.Generator().manual_seed(0)
    image = 0.1 + 0.3 * torch.rand(8, 8, 3, generator=generator)
    true = dict.fromkeys(("total", "surfels", "direct", "indirect"), image)
    kept = torch.ones(8, 8, dtype=torch.bool)
    assert compared(true, true, kept)["total"]["psnr"].value == 100.0
    found = compared(true | {"indirect": 2 * image}, true, kept)
    assert found["indirect"]["bias"].value == pytest.approx(100.0, abs=1e-4)
    assert found["direct"]["bias"].value == pytest.approx(0.0, abs=1e-6)


def test_pixels_that_are_not_kept_do_not_count() -> None:
    true = dict.fromkeys(("total", "surfels", "direct", "indirect"), torch.full((8, 8, 3), 0.2))
    kept = torch.zeros(8, 8, dtype=torch.bool)
    kept[2:4] = True
    wrong = {name: torch.where(kept[..., None], image, 7.0) for name, image in true.items()}
    assert compared(wrong, true, kept)["total"]["psnr"].value == 100.0


@pytest.mark.parametrize("name", SCENES)
def test_kept_pixels_are_solid_and_stay_away_from_steps_of_depth(name: str) -> None:
    view = load_scene(name).test[0]
    kept, depth = clear_of_silhouettes(view), view.read("depth")[..., 0]
    assert bool((view.read("alpha")[..., 0][kept] > SOLID_ALPHA).all())
    assert 0.1 < float(kept.double().mean()) < 0.6
    # No neighbour MARGIN pixels to the right lies on another surface: 0.4 units is more than any kept slope gives.
    beside = (depth[:, MARGIN:] - depth[:, :-MARGIN]).abs()
    assert float(beside[kept[:, :-MARGIN] & kept[:, MARGIN:]].max()) < 0.4


@pytest.mark.parametrize("name", SCENES)
def test_the_larger_views_show_their_stated_scene(name: str) -> None:
    """Surfels on the surfaces that the scene knows, seen from the views' cameras, have the views' depth."""
    from radiogs_core.transport.splatting import splat

    scene = load_scene(name)
    surfels = known_scene(scene, 0.06).surfels
    for view in scene.test:
        seen = splat(view.camera.to(CPU, torch.float32), surfels, {}, depth_unit=1.0)
        kept = clear_of_silhouettes(view)
        error = (seen.depth - view.read("depth")[..., 0]).abs()[kept]
        # At creases a Gaussian reaches past the edge by half a step.
        assert float(error.median()) < 0.006
        assert float(error.quantile(0.99)) < 0.06
        assert float(seen.alpha[kept].min()) > 0.9


def test_metadata_and_names_of_the_larger_views() -> None:
    assert set(forward_names()) == {*SCENES, "furnace-0.2", "furnace-0.5", "furnace-0.8"}
    for name in SCENES:
        about = json.loads((FORWARD / name / "metadata.json").read_text())
        assert about["scene"] == name.removesuffix("-128")
        assert about["noise_floor_db"] > 50


def test_a_scene_whose_surfaces_or_light_are_not_known_is_refused() -> None:
    scene = load_scene("corner-128")
    with pytest.raises(DataError, match="surfaces of scene 'corner-128' are not known"):
        known_scene(replace(scene, surfaces=None), 0.5)
    with pytest.raises(DataError, match="is not known"):
        known_scene(replace(scene, training_light=None), 0.5)


@pytest.mark.slow
def test_a_small_furnace_is_solved_compared_and_stored(tmp_path: Path) -> None:
    scene = load_scene("furnace-0.5")
    cost = replace(PRESETS["smoke"], finetune_iterations=80, finetune_surfels=400, finetune_samples=48)
    settings = {"spacing": 0.3, "offset": 0.1}
    cell = cell_of(RADIOGS, scene, Work(Variant(), cost, experiment="forward-parity", settings=settings))
    store = Store(tmp_path)
    with Interruption() as interruption:
        run_forward_parity(Bench(store, CPU, LogProgress(), interruption, method, checksum_now), cell, scene)
    result = store.result(cell.key)
    biases = {part: result["metrics"][f"{part}/bias"]["value"] for part in ("total", "direct", "indirect", "surfels")}
    assert all(value is not None and abs(value) < 4 for value in biases.values()), biases
    assert result["work"]["solve"]["rays"] == 80 * 400 * 48 + 400 * 48
    assert store.arrays_path(cell.key).exists()
