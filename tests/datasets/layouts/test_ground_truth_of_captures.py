"""Maps that cannot be what they are taken for are refused before anything is trained or scored."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from datasets.orb_captures import SIDE, write_captures
from radiogs_bench.scoring.metrics.geometry import normal_mae
from radiogs_core.errors import DataError
from radiogs_core.scene.scene import View
from radiogs_datasets import load_scene
from radiogs_datasets.image_files import read_image, write_png
from radiogs_datasets.registry import TINY


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    return write_captures(tmp_path)


def read_all(folder: Path) -> None:
    """Open the scene, and read each of its maps as ``train`` does before it begins."""
    scene = load_scene(str(folder))
    for view in (*scene.train, *scene.test, *scene.relight):
        for name in view.sources:
            view.read(name)


def truth_of(folder: Path) -> Path:
    return folder.parent.parent / "ground_truth" / folder.name


@pytest.mark.parametrize("shape", [(1, 1), (SIDE, 1), (SIDE // 2, SIDE // 2)])
@pytest.mark.parametrize("kind", ["surface_normal", "z_depth"])
def test_arrays_of_another_size_are_refused(capture: Path, kind: str, shape: tuple[int, int]) -> None:
    """Audit M12: a normal map of 1 x 1 was spread over all pixels."""
    channels = (3,) if kind == "surface_normal" else ()
    np.save(truth_of(capture) / kind / "0001.npy", np.ones((*shape, *channels), np.float32))
    with pytest.raises(DataError, match=r"0001\.npy is"):
        read_all(capture)


def test_albedo_and_masks_of_another_size_are_refused(capture: Path) -> None:
    """Audit M20: they ended in a traceback after training."""
    albedo, mask = truth_of(capture) / "pseudo_gt_albedo/0000.png", capture / "test_mask/0000.png"
    for path, channels in ((albedo, 3), (mask, 1)):
        kept = path.read_bytes()
        write_png(path, np.ones((SIDE, SIDE // 2, channels), np.float32))
        with pytest.raises(DataError, match=r"0000\.png is 16 x 32 pixels"):
            read_all(capture)
        path.write_bytes(kept)
    read_all(capture)


def test_masks_of_the_levels_zero_and_one_are_refused(capture: Path) -> None:
    """Audit M12: they gave an alpha of .004."""
    path = capture / "train_mask/0000.png"
    write_png(path, read_image(path) / 255)
    with pytest.raises(DataError, match="levels 0 and 1"):
        read_all(capture)


def test_numbers_that_float32_does_not_hold_are_refused(capture: Path) -> None:
    """Audit M12: float64 1e300 became infinite after it had been tested."""
    np.save(truth_of(capture) / "z_depth/0000.npy", np.full((SIDE, SIDE), 1e300))
    with pytest.raises(DataError, match=r"beyond 3\.4e38"):
        read_all(capture)


def test_grey_normals_are_no_truth(tmp_path: Path) -> None:
    """Audit M12: normals of (128, 128, 128) were scored as directions."""
    folder = tmp_path / "bowl"
    shutil.copytree(TINY / "bowl", folder)
    path = sorted(folder.glob("test_*/normal.png"))[0]
    stored = read_image(path)

    def reopened() -> View:
        return next(view for view in load_scene(str(folder)).test if view.name == path.parent.name)

    solid = (reopened().read("alpha")[..., 0] > 0.5).nonzero()
    row, column = solid[len(solid) // 2].tolist()
    stored[row, column, :3] = 128 / 255
    write_png(path, stored)
    assert not reopened().read("normal")[row, column].any()
    stored[..., :3] = 128 / 255
    write_png(path, stored)
    with pytest.raises(DataError, match="no direction"):
        reopened().read("normal")


def test_pixels_without_a_true_normal_are_not_scored() -> None:
    """Audit M12: without a true direction every prediction has the same error, which means nothing."""
    target = torch.zeros(4, 4, 3)
    target[:2, :, 2] = 1
    mine = torch.zeros(4, 4, 3)
    mine[..., 2] = 1
    assert normal_mae(mine, target, torch.ones(4, 4, 1)) == pytest.approx(0)
    assert normal_mae(target, mine, torch.ones(4, 4, 1)) == pytest.approx(45)


@pytest.mark.parametrize("other", ["train", "test"])
def test_a_view_that_links_to_another_is_refused(tmp_path: Path, other: str) -> None:
    """Audit M4: a symlinked folder passed as another view, and so a test view was trained on."""
    folder = tmp_path / "bowl"
    shutil.copytree(TINY / "bowl", folder)
    place = sorted(folder.glob(f"{other}_*"))[1]
    shutil.rmtree(place)
    place.symlink_to(folder / "train_000")
    with pytest.raises(DataError, match="one image for 2 views") as caught:
        load_scene(str(folder))
    assert place.name in caught.value.what
    assert "train_000" in caught.value.what
