"""Photos of every lens become pinhole images: known points lie where the pinhole camera puts them.

The photos are drawn here by COLMAP's own formulas (its ``sensor/models.h``), written out again: a bright dot for each
of some points in the world.
"""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from datasets.lenses import FOCAL, HEIGHT, LENSES, TOLERANCE, WIDTH, bent, dot_near, dots
from radiogs_core.errors import UsageError
from radiogs_core.scene.colour import srgb_decode
from radiogs_core.scene.scene import Scene
from radiogs_datasets import load_scene
from radiogs_datasets.cameras.lens import Lens, lens_of
from radiogs_datasets.cameras.undistortion import pinhole_of, undistorted, undistorted_depth
from radiogs_datasets.options import SceneOptions, options_of


def points_before_the_camera() -> np.ndarray:
    """A grid of points over the image, at several depths, in the camera's axes."""
    column, row = np.meshgrid(np.linspace(-0.6, 0.6, 9), np.linspace(-0.45, 0.45, 7))
    depth = 3 + np.arange(column.size) % 5
    return np.stack([column.ravel() * depth, row.ravel() * depth, depth], -1)


def write_model(folder: Path, model: str, parameters: tuple[float, ...], names: list[str], size: str = "") -> None:
    """A model in text, its cameras at the origin of the world, along its axes."""
    place = folder / "sparse"
    place.mkdir(parents=True)
    values = " ".join(map(repr, parameters))
    (place / "cameras.txt").write_text(f"1 {model} {size or f'{WIDTH} {HEIGHT}'} {values}\n")
    lines = [f"{number} 1 0 0 0 0 0 0 1 {name}\n" for number, name in enumerate(names, start=1)]
    (place / "images.txt").write_text("\n".join(lines) + "\n")
    (place / "points3D.txt").write_text("")


@pytest.fixture
def photographed(tmp_path: Path) -> Callable[[str], tuple[Scene, np.ndarray]]:
    """A scene of two photos through the lens of a model, and the points that they show."""

    def make(model: str) -> tuple[Scene, np.ndarray]:
        folder = tmp_path / model
        write_model(folder, model, LENSES[model], ["a.png", "b.png"])
        (folder / "images").mkdir()
        points = points_before_the_camera()
        picture = dots(bent(model, LENSES[model], points))
        for name in ("a.png", "b.png"):
            cv2.imwrite(str(folder / "images" / name), picture)
        return load_scene(str(folder)), points

    return make


@pytest.mark.slow
@pytest.mark.parametrize("model", list(LENSES))
def test_known_points_lie_where_the_pinhole_camera_puts_them(
    model: str, photographed: Callable[[str], tuple[Scene, np.ndarray]]
) -> None:
    scene, points = photographed(model)
    (view,) = scene.train
    camera, image = view.camera, view.read("image").numpy()
    assert image.shape == (camera.height, camera.width, 3)
    seen = 0
    for x, y, z in points:
        column, row = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        if 8 < column < camera.width - 8 and 8 < row < camera.height - 8:
            found = dot_near(image[..., 0], column, row)
            assert found == pytest.approx((column, row), abs=TOLERANCE), (x, y, z)
            seen += 1
    assert seen >= 15


@pytest.mark.parametrize("model", [model for model in LENSES if model not in ("SIMPLE_PINHOLE", "PINHOLE")])
def test_the_test_bends_images_so_far_that_it_would_notice(model: str) -> None:
    """Most dots of the photo are pixels away from where a pinhole camera of the same focal length would put them."""
    parameters, points = LENSES[model], points_before_the_camera()
    lens = lens_of(model, parameters, WIDTH, HEIGHT)
    straight = np.stack(
        [lens.fx * points[:, 0] / points[:, 2] + lens.cx, lens.fy * points[:, 1] / points[:, 2] + lens.cy], -1
    )
    off = np.linalg.norm(bent(model, parameters, points) - straight, axis=-1)
    assert np.median(off) > 1


def test_our_formulas_are_colmaps() -> None:
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    points = points_before_the_camera()
    for model, parameters in LENSES.items():
        camera = pycolmap.Camera(model=model, width=WIDTH, height=HEIGHT, params=list(parameters))
        np.testing.assert_allclose(camera.img_from_cam(points), bent(model, parameters, points), atol=1e-6)


def test_every_pixel_that_is_kept_has_a_source_and_the_image_is_not_cut_for_nothing() -> None:
    for model, parameters in LENSES.items():
        lens = lens_of(model, parameters, WIDTH, HEIGHT)
        kept = pinhole_of(lens)
        white = torch.ones(HEIGHT, WIDTH, 3)
        framed = white.clone()
        framed[0], framed[-1], framed[:, 0], framed[:, -1] = 0, 0, 0, 0
        assert float(undistorted(white, None, lens).min()) > 1 - 1e-6
        # The part with the outermost pixels cannot have been cut away much: the kept rectangle touches them somewhere.
        assert (kept.width, kept.height) == (WIDTH, HEIGHT) or float(undistorted(framed, None, lens).min()) < 0.9


@pytest.mark.parametrize(
    ("model", "parameters"),
    [
        ("SIMPLE_RADIAL", (240.0, 160.0, 120.0, -0.1)),
        ("OPENCV", (240.0, 240.0, 160.0, 120.0, -0.2, 0.05, 0.0, 0.0)),
        ("SIMPLE_RADIAL", (240.0, 160.0, 120.0, 0.15)),
    ],
)
def test_the_image_keeps_what_colmaps_undistorter_keeps(model: str, parameters: tuple[float, ...]) -> None:
    """It grows with a barrel lens and shrinks with a pincushion, to COLMAP's size without blank pixels."""
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    camera = pycolmap.Camera(model=model, width=WIDTH, height=HEIGHT, params=list(parameters))
    theirs = pycolmap.undistort_camera(pycolmap.UndistortCameraOptions(), camera)
    lens = lens_of(model, parameters, WIDTH, HEIGHT)
    kept = pinhole_of(lens)
    assert (kept.width, kept.height) == pytest.approx((theirs.width, theirs.height), abs=2)
    assert (kept.width > WIDTH) == (parameters[-1] <= 0 and min(parameters) < 0)
    white = undistorted(torch.ones(HEIGHT, WIDTH, 3), None, lens)
    assert white.shape == (kept.height, kept.width, 3)
    assert kept.camera(torch.eye(4)).cx == lens.cx - kept.left


def test_a_lens_without_distortion_leaves_every_value_as_it_is(tmp_path: Path) -> None:
    folder = tmp_path / "plain"
    write_model(folder, "OPENCV", (FOCAL, FOCAL, 160, 120, 0, 0, 0, 0), ["a.png", "b.png"])
    (folder / "images").mkdir()
    levels = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(folder / "images" / name), levels)
    (view,) = load_scene(str(folder)).train
    np.testing.assert_array_equal(np.rint(view.read("image").numpy() * 255), levels[..., ::-1])


def test_a_lens_that_folds_back_shows_nothing_twice() -> None:
    """r (1 - 0.9 r^2) turns back at r = 0.61: what lies outside would repeat the inside, mirrored."""
    lens = Lens(100.0, 100.0, 160.0, 120.0, WIDTH, HEIGHT, "perspective", (-0.9, *[0.0] * 7))
    kept = pinhole_of(lens)
    column = torch.arange(WIDTH, dtype=torch.float32).expand(HEIGHT, WIDTH)[..., None]
    sources = undistorted_depth(column, lens)[..., 0]
    assert bool((sources.diff(dim=1) >= 0).all())
    assert 80 < kept.width < 0.61 * 200 + 4


def test_colour_between_pixels_is_their_linear_mean() -> None:
    """A photo of single-pixel black and white columns, half a pixel off: half the light, not half the level."""
    lens = Lens(100.0, 100.0, 160.0, 120.0, WIDTH, HEIGHT, "perspective", (1e-3, *[0.0] * 7))
    stripes = (torch.arange(WIDTH) % 2).float().expand(HEIGHT, WIDTH)[..., None].repeat(1, 1, 3)
    image = undistorted(stripes, None, lens)
    assert float(srgb_decode(image).mean()) == pytest.approx(0.5, abs=0.01)


def test_uncovered_colour_does_not_bleed_into_the_object() -> None:
    lens = lens_of("SIMPLE_RADIAL", LENSES["SIMPLE_RADIAL"], WIDTH, HEIGHT)
    image = torch.zeros(HEIGHT, WIDTH, 3)
    image[:, 150:] = 0.8
    alpha = torch.zeros(HEIGHT, WIDTH, 1)
    alpha[:, 150:] = 1
    colours = undistorted(image, alpha, lens)
    assert bool(((colours - 0.8).abs().lt(1e-4) | colours.eq(0)).all())


@pytest.mark.parametrize(
    ("model", "bent"),
    [
        ("SIMPLE_RADIAL", (0.3,)),
        ("OPENCV", (-0.2, 0.05, 0.01, -0.01)),
        ("OPENCV_FISHEYE", (0.05, -0.02, 0.004, -0.001)),
    ],
)
def test_photos_that_are_undistorted_already_keep_their_pixels(
    tmp_path: Path, model: str, bent: tuple[float, ...]
) -> None:
    """A lens that bends by a fifth: the pixels are the file's, the camera is the lens without its distortion."""
    folder, options = tmp_path / "bent", SceneOptions(undistorted=True)
    lens = ((90.0,) if model == "SIMPLE_RADIAL" else (90.0, 90.0)) + (64.0, 48.0, *bent)
    write_model(folder, model, lens, ["a.png", "b.png"], "128 96")
    (folder / "images").mkdir()
    pixels = np.random.default_rng(3).integers(0, 256, (96, 128, 3), dtype=np.uint8)
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(folder / "images" / name), pixels[..., ::-1])
    undone, straight = load_scene(str(folder)), load_scene(str(folder), options=options)
    assert any(said.endswith("need --undistorted") for said in undone.repairs)
    assert not any("distort" in said for said in straight.repairs)
    assert np.array_equal(np.rint(255 * straight.train[0].read("image").numpy()), pixels)
    camera = straight.train[0].camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy, camera.width) == (90, 90, 64, 48, 128)
    assert straight.checksum != undone.checksum
    assert options_of(options.plain()) == options
    (folder / "sparse/cameras.txt").write_text("1 PINHOLE 128 96 90 90 64 48\n")
    with pytest.raises(UsageError, match="no camera of the scene has any"):
        load_scene(str(folder), options=options)
