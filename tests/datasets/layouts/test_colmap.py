"""COLMAP's models: points on their pixels, the split, reduced images, and what cannot be used."""

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from radiogs_core.errors import DataError
from radiogs_datasets import load_scene

VIEWS, WIDTH, HEIGHT = 9, 64, 48
FX, FY, CX, CY = 70.0, 72.0, 33.0, 23.0


def rotation(angle: float) -> np.ndarray:
    """World to camera, OpenCV axes: at angle zero it looks along +x with z up."""
    turned = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]]) @ turned


def quaternion(matrix: np.ndarray) -> np.ndarray:
    """(w, x, y, z) of a rotation, from the eigenvector of its symmetric form."""
    m = matrix
    form = np.array(
        [
            [m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], m[1, 1] - m[0, 0] - m[2, 2], m[1, 2] + m[2, 1]],
            [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], m[2, 2] - m[0, 0] - m[1, 1]],
        ]
    )
    return np.linalg.eigh(form)[1][:, -1]


def translation(k: int) -> np.ndarray:
    return -rotation(0.3 * k) @ (-4 * np.array([np.cos(0.3 * k), np.sin(0.3 * k), 0.0]))


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """A model in COLMAP's text format, written by hand, with JPEG images."""
    folder = tmp_path / "garden ü"
    model = folder / "sparse/0"
    model.mkdir(parents=True)
    (model / "cameras.txt").write_text(f"# cameras\n1 PINHOLE {WIDTH} {HEIGHT} {FX} {FY} {CX} {CY}\n")
    lines = []
    for k in range(VIEWS):
        numbers = " ".join(f"{value:.12f}" for value in (*quaternion(rotation(0.3 * k)), *translation(k)))
        lines += [f"{k + 1} {numbers} 1 view_{VIEWS - k:02}.jpg", ""]
    (model / "images.txt").write_text("\n".join(lines) + "\n")
    (model / "points3D.txt").write_text("1 0.1 0.2 0.3 255 128 0 0.5\n2 -0.5 0 1 0 0 255 0.1\n")
    (folder / "images").mkdir()
    for k in range(VIEWS):
        image = np.full((HEIGHT, WIDTH, 3), 20 * k, np.uint8)
        cv2.imwrite(str(folder / f"images/view_{VIEWS - k:02}.jpg"), image)
    return folder


def test_known_points_land_on_their_pixels(scene: Path) -> None:
    loaded = load_scene(str(scene))
    assert loaded.layout == "colmap"
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 3))
    by_name = {view.name: view for view in (*loaded.train, *loaded.test)}
    for k in range(VIEWS):
        x, y, z = (points @ rotation(0.3 * k).T + translation(k)).T
        camera = by_name[f"view_{VIEWS - k:02}"].camera.to(dtype=torch.float64)
        seen = (torch.from_numpy(points) - camera.centre) @ camera.axes
        np.testing.assert_allclose(camera.fx * seen[:, 0] / seen[:, 2] + camera.cx, FX * x / z + CX, atol=1e-3)
        np.testing.assert_allclose(camera.fy * seen[:, 1] / seen[:, 2] + camera.cy, FY * y / z + CY, atol=1e-3)


def test_every_eighth_view_by_name_is_scored_and_points_come_along(scene: Path) -> None:
    loaded = load_scene(str(scene))
    assert [view.name for view in loaded.test] == ["view_01", "view_09"]
    assert len(loaded.train) == 7
    torch.testing.assert_close(loaded.points.positions[0], torch.tensor([0.1, 0.2, 0.3]))
    torch.testing.assert_close(loaded.points.colours[1], torch.tensor([0.0, 0.0, 1.0]))
    assert loaded.test[1].read("image").shape == (HEIGHT, WIDTH, 3)
    assert "no alpha: every pixel counts" in loaded.repairs


def test_reduced_images_bring_their_cameras_with_them(scene: Path) -> None:
    (scene / "images_2").mkdir()
    for path in (scene / "images").iterdir():
        cv2.imwrite(str(scene / "images_2" / path.name), cv2.imread(str(path))[::2, ::2])
    loaded = load_scene(str(scene))
    camera = loaded.train[0].camera
    assert (camera.width, camera.height) == (WIDTH // 2, HEIGHT // 2)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (FX / 2, FY / 2, CX / 2, CY / 2)
    assert "photos are read from images_2/" in loaded.repairs


def halve(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def replace(path: Path, old: str, new: str) -> None:
    path.write_text(path.read_text().replace(old, new))


MODEL = "sparse/0"
MISTAKES: dict[str, tuple[Callable[[Path], object], str]] = {
    "cut JPEG": (lambda f: halve(f / "images/view_03.jpg"), "view_03.jpg is damaged"),
    "a JPEG that is none": (lambda f: (f / "images/view_03.jpg").write_bytes(b"no"), "view_03.jpg"),
    "an image missing": (lambda f: (f / "images/view_03.jpg").unlink(), "lacks 1 file: images/view_03.jpg"),
    "no images": (lambda f: shutil.rmtree(f / "images"), "lacks 9 files"),
    "no poses": (lambda f: (f / MODEL / "images.txt").unlink(), "cannot read the model"),
    "a lens that OpenCV has no formula for": (
        lambda f: (f / MODEL / "cameras.txt").write_text(f"1 FOV {WIDTH} {HEIGHT} 70 72 33 23 0.1\n"),
        "is of model FOV",
    ),
    "focal length of zero": (lambda f: replace(f / MODEL / "cameras.txt", "70.0", "0"), "above zero"),
    "images of another shape": (
        lambda f: [cv2.imwrite(str(path), np.zeros((40, 40, 3), np.uint8)) for path in (f / "images").iterdir()],
        "is 40 x 40 pixels",
    ),
    "a name that leads out": (
        lambda f: replace(f / MODEL / "images.txt", "view_09.jpg", "../../../../x.jpg"), "nothing outside that is read"
    ),
    "one view": (lambda f: (f / MODEL / "images.txt").write_text(
        "\n".join((f / MODEL / "images.txt").read_text().splitlines()[:2]) + "\n"), "has 1 images"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", list(MISTAKES))
def test_a_mistake_is_one_clear_error(mistake: str, scene: Path) -> None:
    make, words = MISTAKES[mistake]
    make(scene)
    with pytest.raises(DataError) as caught:
        load_scene(str(scene))
    assert words in str(caught.value)
    assert len(str(caught.value).splitlines()) <= 3
