"""Each kind of unused file is reported in a sentence; there is no sentence if all files are used."""

import shutil
from pathlib import Path

import cv2
import pytest

from radiogs_core.errors import DataError
from radiogs_datasets import load_scene
from radiogs_datasets.check import check_scene
from radiogs_datasets.options import SceneOptions
from radiogs_datasets.registry import TINY


def said(folder: Path) -> list[str]:
    """The sentences beyond the usual, by loading and by the check alike."""
    repairs = load_scene(str(folder)).repairs
    assert {finding.what for finding in check_scene(str(folder)).findings} >= {*repairs}
    usual = ("photos are read", "every 8th", "no alpha", "1 view to score", "the model has no points3D")
    return [line for line in repairs if not line.startswith(usual)]


def model(folder: Path, place: str, chosen: slice) -> None:
    """A model of some of the photos."""
    lines = (folder / "sparse/0/images.txt").read_text().split("\n")
    poses = lines[::2][chosen]
    (folder / place).mkdir(parents=True, exist_ok=True)
    for part in ("cameras", "points3D"):
        target = folder / place / f"{part}.txt"
        if not target.exists():
            shutil.copy(folder / "sparse/0" / f"{part}.txt", target)
    (folder / place / "images.txt").write_text("".join(f"{pose}\n\n" for pose in poses if pose))


def test_a_scene_without_unused_files_has_no_remark(capture: Path) -> None:
    assert said(capture) == []


def test_the_model_with_the_most_photos_is_taken_and_the_others_are_named(capture: Path) -> None:
    model(capture, "sparse/1", slice(0, 12))
    model(capture, "sparse/2", slice(0, 4))
    model(capture, "sparse/0", slice(0, 3))
    scene = load_scene(str(capture))
    assert len(scene.train) + len(scene.test) == 12
    assert said(capture) == [
        "the model in sparse/1 is used (12 photos), the largest; not used: sparse/0 (3 photos), sparse/2 (4 photos)"
    ]


def test_a_second_model_that_cannot_be_read_is_named(capture: Path) -> None:
    model(capture, "sparse/1", slice(0, 4))
    (capture / "sparse/1/images.txt").unlink()
    (line,) = said(capture)
    assert line.startswith("the model in sparse/1 is not used: cannot read the model")


def test_photos_without_a_camera_are_one_sentence(capture: Path) -> None:
    model(capture, "sparse/0", slice(0, 4))
    (line,) = said(capture)
    assert line.startswith("8 of 12 photos are in no view and are not used: images/photo_005.png,")


def test_text_files_beside_a_binary_model_are_named(capture: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    pycolmap.Reconstruction(str(capture / "sparse/0")).write_binary(str(capture / "sparse/0"))
    (line,) = said(capture)
    assert line == "cameras.txt, images.txt, points3D.txt in sparse/0 are not used: the binary files are"
    text = (capture / "sparse/0/images.txt").read_text()
    (capture / "sparse/0/images.txt").write_text(text.replace("photo_001", "photo_901"))
    assert said(capture)[0].endswith("the binary files are; they hold other photos or poses")


@pytest.mark.parametrize("name", ["{}.png", "{}.png.png", "{}_mask.png"])
def test_masks_that_are_not_used_are_named_with_the_option(capture: Path, name: str) -> None:
    (capture / "masks").mkdir()
    for mask in sorted((capture.parent / "kept_masks").iterdir()):
        shutil.copy(mask, capture / "masks" / name.format(mask.stem))
    assert said(capture) == [f"masks/ has a mask for each photo, and is not used:  --mask-folder {capture}/masks"]
    given = load_scene(str(capture), options=SceneOptions(mask_folder=str(capture / "masks")))
    assert not given.surrounded
    assert not any("not used" in line for line in given.repairs)
    next((capture / "masks").iterdir()).unlink()
    assert said(capture) == ["masks/ is not used: it has masks for 11 of 12 photos"]


def test_other_sizes_moving_masks_and_other_images_are_named_once(capture: Path) -> None:
    for name in ("images_4", "images_8", "input"):
        shutil.copytree(capture / "images", capture / name)
    shutil.copytree(capture / "images", capture / "images_2")
    shutil.copy(capture / "images/photo_001.png", capture / "images_2/dynamic_mask_photo_001.png")
    shutil.copy(capture / "images/photo_001.png", capture / "preview.png")
    (capture / "images/._photo_001.png").write_bytes(b"macOS")
    assert check_scene(str(capture)).sound
    assert said(capture) == [
        "1 mask of what moves is not used: images_2/dynamic_mask_photo_001.png; to leave such pixels out, give a folder"
        " of masks that are black there:  --mask-folder DIR --masks ignore",
        "photos of other sizes are not used: images (12), images_4 (12), images_8 (12)",
        "13 other images are not used: 1 in the folder itself, 12 in input",
    ]


def test_other_splits_are_named(tmp_path: Path) -> None:
    folder = Path(shutil.copytree(TINY / "corner", tmp_path / "corner"))
    shutil.copytree(folder / "test_000", folder / "val/val_000")
    (folder / "transforms_val.json").write_text((folder / "transforms_test.json").read_text())
    count = len(list((folder / "val").rglob("*.png"))) + len(list((folder / "val").rglob("*.exr")))
    assert load_scene(str(folder)).repairs == (f"transforms_val.json is not used, nor are {count} images in val",)


def test_a_model_without_lines_of_features_is_refused(capture: Path) -> None:
    images = capture / "sparse/0/images.txt"
    written = images.read_text()
    images.write_text(written.replace("\n\n", "\n"))
    with pytest.raises(DataError, match=r"line 2 is no list of features: 2 "):
        load_scene(str(capture))
    spaced = written.replace("photo_", "a photo ").replace("\n\n", "\n")  # then a pose has a multiple of three words
    images.write_text(spaced)
    with pytest.raises(DataError, match="is no list of features"):
        load_scene(str(capture))
    images.write_text(written.replace("\n\n", "\n1.5 2.5 -1 3 4 17\n"))
    assert len(load_scene(str(capture)).train) == 10


def test_a_model_that_lists_fewer_photos_than_it_counts_is_refused(capture: Path) -> None:
    images = capture / "sparse/0/images.txt"
    written = images.read_text()
    images.write_text("# Number of images: 12, mean observations per image: 0\n" + written)
    load_scene(str(capture))
    images.write_text("# Number of images: 13, mean observations per image: 0\n" + written)
    with pytest.raises(DataError, match="its header counts 13, 12 are listed"):
        load_scene(str(capture))


def test_views_whose_names_differ_in_the_ending_alone_are_refused(capture: Path) -> None:
    """Renders of both would be stored under one name, and half of the views never be scored."""
    images = capture / "sparse/0/images.txt"
    images.write_text(images.read_text().replace("photo_002.png", "photo_001.jpg"))

    cv2.imwrite(str(capture / "images/photo_001.jpg"), cv2.imread(str(capture / "images/photo_002.png")))
    with pytest.raises(DataError, match="two views called 'photo_001'"):
        load_scene(str(capture))
