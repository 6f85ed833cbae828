"""Stored results were made from the files whose checksum is in their key."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bench.fake_method import CPU, FakeStage, FakeSweep, FakeTrained, evaluate, fake_cell
from radiogs_bench.runs.cell import Cell
from radiogs_bench.runs.scene_checksum import checksum_now
from radiogs_bench.runs.stages import Bench
from radiogs_bench.runs.train import train_and_score
from radiogs_bench.runs.unchanged_scene import require_unchanged, require_unchanged_if_touched
from radiogs_bench.scoring.evaluate import Evaluation
from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Scene
from radiogs_datasets import load_scene
from radiogs_datasets.enlargement import enlarged
from radiogs_datasets.options import SceneOptions

CORNER = load_scene("corner").folder


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    assert CORNER is not None
    return load_scene(str(shutil.copytree(CORNER, tmp_path / "corner")))


def image_of(scene: Scene) -> Path:
    return sorted(scene.folder.rglob("rgba.png"))[-1]


def repaint(scene: Scene) -> None:
    """Replace an image by a black one of equal size."""
    with Image.open(image_of(scene)) as image:
        size = image.size
    levels = np.zeros((size[1], size[0], 4), np.uint8)
    levels[..., 3] = 255  # an image without any coverage would be refused for that
    Image.fromarray(levels).save(image_of(scene))


def read_all(scene: Scene) -> None:
    for view in (*scene.train, *scene.test):
        for name in view.sources:
            view.read(name)


def train(scene: Scene, folder: Path, score: Callable[..., Evaluation] = evaluate) -> Cell:
    cell = fake_cell(scene=scene)
    train_and_score(FakeSweep(folder).bench, cell, scene, score=score)
    return cell


@pytest.mark.slow
@pytest.mark.parametrize("options", [SceneOptions(), SceneOptions(reduce=2)], ids=["as stored", "reduced"])
def test_unchanged_files_agree_with_the_checksum(scene: Scene, options: SceneOptions) -> None:
    for each in (scene, load_scene(str(scene.folder), options=options), load_scene("corner"), load_scene("hard-cases")):
        require_unchanged(each, checksum_now)
        require_unchanged_if_touched(each, checksum_now)
    require_unchanged(enlarged(scene, 3, 2, 48, 40, masks=True), checksum_now)


@pytest.mark.parametrize("change", [repaint, lambda scene: image_of(scene).unlink()], ids=["painted", "deleted"])
def test_changed_files_are_named(scene: Scene, change: Callable[[Scene], None]) -> None:
    require_unchanged_if_touched(scene, checksum_now)
    change(scene)
    for check in (require_unchanged, require_unchanged_if_touched):
        with pytest.raises(DataError, match="'corner' were changed while they were in use"):
            check(scene, checksum_now)


def test_files_that_were_only_touched_are_the_same(scene: Scene) -> None:
    require_unchanged_if_touched(scene, checksum_now)
    image_of(scene).write_bytes(image_of(scene).read_bytes())
    require_unchanged_if_touched(scene, checksum_now)


@pytest.mark.slow
def test_images_that_are_replaced_while_they_are_scored_leave_no_result(scene: Scene, tmp_path: Path) -> None:
    """Audit M1: 8.26 dB were kept under the key of the true scene, also after its images were put back."""
    whole = image_of(scene).read_bytes()

    def replacing(bench: Bench, cell: Cell, given: Scene, model: FakeTrained) -> Evaluation:
        repaint(given)
        return evaluate(bench, cell, given, model)

    with pytest.raises(DataError, match="were changed while they were in use"):
        train(scene, tmp_path / "out", replacing)
    assert not list((tmp_path / "out").glob("cells/*"))
    image_of(scene).write_bytes(whole)
    cell = train(scene, tmp_path / "out")
    assert FakeSweep(tmp_path / "out").store.result(cell.key) is not None


@pytest.mark.slow
@pytest.mark.parametrize("step", [1, 2, 3])
def test_images_that_are_replaced_while_a_stage_learns_leave_neither_product_nor_checkpoint(
    step: int, scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Audit M1: a checkpoint of the step before is of the true images, and stays."""
    stepped = FakeStage.step

    def replacing(stage: FakeStage) -> object:
        if stage.iteration == step - 1:
            repaint(scene)
        return stepped(stage)

    monkeypatch.setattr(FakeStage, "step", replacing)
    with pytest.raises(DataError, match="were changed while they were in use"):
        train(scene, tmp_path / "out")
    kept = [path.name.partition(".")[2] for path in (tmp_path / "out").glob("stages/*")]
    assert kept == ([] if step == 1 else ["checkpoint.pt"])
    (checkpoint,) = [*(tmp_path / "out").glob("stages/*")] or [None]
    if checkpoint is not None:
        state = FakeSweep(tmp_path / "out").store.tensors(f"stages/{checkpoint.name.removesuffix('.pt')}", CPU)
        assert state["state"]["iteration"] == step - 1


def test_a_scene_whose_checksum_was_of_other_files_is_refused(scene: Scene, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="were changed"):
        train(replace(scene, checksum="1" * 64), tmp_path / "out")


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["rgba.png", "depth.exr"])
def test_a_file_that_was_changed_and_put_back_is_not_decoded(kind: str, scene: Scene, tmp_path: Path) -> None:
    """Audit M1: nobody noticed the change between two digests, and results made from it were kept."""
    assert scene.folder is not None
    path, other = scene.folder / "test_001" / kind, scene.folder / "test_002" / kind
    whole = path.read_bytes()

    def replacing(bench: Bench, cell: Cell, given: Scene, model: FakeTrained) -> Evaluation:
        path.write_bytes(other.read_bytes())
        try:
            read_all(given)
        finally:
            path.write_bytes(whole)
        return evaluate(bench, cell, given, model)

    with pytest.raises(DataError, match="were changed while they were in use") as caught:
        train(scene, tmp_path / "out", replacing)
    assert kind in caught.value.why
    assert not list((tmp_path / "out").glob("cells/*"))
    require_unchanged(scene, checksum_now)
    train(scene, tmp_path / "out")


def test_a_scene_that_is_opened_again_is_held_to_its_files_of_now(scene: Scene) -> None:
    repaint(scene)
    again = load_scene(str(scene.folder))
    assert again.checksum != scene.checksum
    for opened in (again, load_scene(str(scene.folder), options=SceneOptions(reduce=2))):
        (view,) = [view for view in opened.test if view.name == image_of(scene).parent.name] or opened.train[-1:]
        assert float(view.read("image").max()) == 0
    with pytest.raises(DataError, match="were changed while they were in use"):
        read_all(scene)
