"""COLMAP's files: binary and text forms agree, both with pycolmap, and damage is one clear error."""

import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

from radiogs_core.errors import DataError
from radiogs_datasets import load_scene
from radiogs_datasets.cameras.colmap_files import read_model
from radiogs_datasets.cameras.colmap_model import SparseModel, StoredImage

WIDTH, HEIGHT = 40, 30
LENS = (30.0, 31.0, 19.5, 15.5, 0.05, -0.02, 0.001, 0.002)
MOTIONS = [((0.64, 0.48, -0.6, 0.0), (0.5, -0.25, 2.0)), ((0.5, 0.5, 0.5, -0.5), (0.0, 1.0, 3.0)),
           ((0.8, 0.0, 0.0, 0.6), (1.0, 1.0, 1.0))]  # fmt: skip
NAMES = ["set one/a.png", "set one/b ü.png", "c.png"]


def cameras_file(model: int = 4, width: int = WIDTH, height: int = HEIGHT, lens: tuple[float, ...] = LENS) -> bytes:
    return struct.pack("<QiiQQ", 1, 7, model, width, height) + struct.pack(f"<{len(lens)}d", *lens)


def image_record(number: int, name: bytes, motion: tuple[float, ...], camera: int = 7, features: int = 2) -> bytes:
    head = struct.pack("<I7dI", number, *motion, camera) + name + b"\0" + struct.pack("<Q", features)
    unseen = struct.pack("<ddQ", 1.5, 2.5, (1 << 64) - 1)
    return head + unseen + (struct.pack("<ddQ", 1.5, 2.5, 9) if number == 0 else unseen)


def images_file(**changes: object) -> bytes:
    motions = [(*rotation, *translation) for rotation, translation in MOTIONS]
    names = [name.encode() for name in NAMES]
    if "motion" in changes:
        motions[1] = changes.pop("motion")  # type: ignore[call-overload]
    if "name" in changes:
        names[1] = changes.pop("name")  # type: ignore[call-overload]
    records = [image_record(n, name, motions[n], **(changes if n == 1 else {})) for n, name in enumerate(names)]  # type: ignore[arg-type]
    return struct.pack("<Q", 3) + b"".join(records)


def points_file(x: float = 0.1, track: int = 1) -> bytes:
    second = struct.pack("<Q3d3BdQ", 9, x, 0.2, 0.3, 255, 128, 0, 0.5, track) + struct.pack("<II", 0, 1)
    first = struct.pack("<Q3d3BdQ", 4, -1.0, 0.0, 2.0, 1, 2, 3, 0.5, 0)
    return struct.pack("<Q", 2) + second + first


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """The output of ``image_undistorter``: images, and a binary model in ``sparse``, without a folder 0."""
    folder = tmp_path / "eine Szene ü"
    (folder / "images/set one").mkdir(parents=True)
    (folder / "sparse").mkdir()
    for place, name in enumerate(NAMES):
        levels = np.full((HEIGHT, WIDTH, 3), 40 + 60 * place, np.uint8)
        levels[5:9, 5:9] = 0
        (folder / "images" / name).write_bytes(cv2.imencode(".png", levels)[1].tobytes())
    (folder / "sparse/cameras.bin").write_bytes(cameras_file())
    (folder / "sparse/images.bin").write_bytes(images_file())
    (folder / "sparse/points3D.bin").write_bytes(points_file())
    return folder


def write_text(folder: Path) -> None:
    """The same model as text."""
    shutil.rmtree(folder)
    folder.mkdir()
    (folder / "cameras.txt").write_text(f"# one\n7 OPENCV {WIDTH} {HEIGHT} {' '.join(map(repr, LENS))}\n")
    lines = ["# two lines an image"]
    for number, (name, (rotation, translation)) in enumerate(zip(NAMES, MOTIONS, strict=True)):
        motion = " ".join(map(repr, (*rotation, *translation)))
        lines += [f"{number} {motion} 7 {name}", ("1.5 2.5 -1 1.5 2.5 9", "", "1.5 2.5 -1")[number]]
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    (folder / "points3D.txt").write_text("9 0.1 0.2 0.3 255 128 0 0.5 0 1\n4 -1 0 2 1 2 3 0.5\n")


def test_binary_and_text_are_the_same_model(scene: Path) -> None:
    binary = read_model(scene / "sparse")
    write_text(scene / "sparse")
    text = read_model(scene / "sparse")
    assert (text.cameras, text.images) == (binary.cameras, binary.images)
    np.testing.assert_array_equal(text.positions, binary.positions)
    np.testing.assert_array_equal(text.colours, binary.colours)
    assert [image.name for image in text.images] == NAMES
    np.testing.assert_array_equal(binary.positions, [[-1, 0, 2], [0.1, 0.2, 0.3]])
    np.testing.assert_array_equal(binary.colours, [[1, 2, 3], [255, 128, 0]])


def test_a_model_without_a_numbered_folder_is_a_scene(scene: Path) -> None:
    loaded = load_scene(str(scene))
    assert loaded.layout == "colmap"
    assert [view.name for view in (*loaded.test, *loaded.train)] == ["c", "set one/a", "set one/b ü"]
    assert any(line.startswith("lens distortion of 3 photos is undone on reading") for line in loaded.repairs)
    view = loaded.train[0]
    assert view.read("image").shape == (view.camera.height, view.camera.width, 3)
    assert loaded.points.positions.tolist()[0] == [-1, 0, 2]


@pytest.mark.parametrize("text", [False, True])
def test_pycolmap_reads_the_same(scene: Path, text: bool) -> None:
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    if text:
        write_text(scene / "sparse")
        # pycolmap takes a name in text up to its first space; COLMAP itself writes such names as they are.
        replaced("sparse/images.txt", "set one/b ü", "b")(scene)
        replaced("sparse/images.txt", "set one", "set_one")(scene)
    compare(scene / "sparse", pycolmap)


def test_the_statuette_is_read_as_by_pycolmap(shared_data: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    model = compare(shared_data / "colmap_statuette/sparse", pycolmap)
    assert (len(model.images), len(model.positions)) == (23, 1443)


def compare(folder: Path, pycolmap: ModuleType) -> SparseModel:
    ours, theirs = read_model(folder), pycolmap.Reconstruction(str(folder))
    assert {image.name for image in ours.images} == {image.name for image in theirs.images.values()}
    by_name = {image.name: image for image in theirs.images.values()}
    for image in ours.images:
        matrix = np.eye(4)
        matrix[:3] = by_name[image.name].cam_from_world().matrix()
        np.testing.assert_allclose(image.camera_to_world(), np.linalg.inv(matrix), atol=1e-9)
    for number, camera in ours.cameras.items():
        other = theirs.cameras[number]
        assert (camera.model, camera.width, camera.height) == (other.model.name, other.width, other.height)
        assert camera.parameters == tuple(other.params)
    points = [point for _, point in sorted(theirs.points3D.items())]
    np.testing.assert_array_equal(ours.positions, [point.xyz for point in points])
    np.testing.assert_array_equal(ours.colours, [point.color for point in points])
    return ours


def test_a_quaternion_of_any_length_is_the_same_rotation() -> None:
    rotation, translation = MOTIONS[0]
    longer = StoredImage("a", 1, tuple(3 * value for value in rotation), translation)  # type: ignore[arg-type]
    np.testing.assert_allclose(
        longer.camera_to_world(), StoredImage("a", 1, rotation, translation).camera_to_world(), atol=1e-12
    )


def test_a_photo_is_not_turned_by_its_exif_mark(scene: Path) -> None:
    """COLMAP measures in the stored pixels; a decoder that turns them would leave the camera behind."""
    levels = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    levels[: HEIGHT // 2] = 200
    data = cv2.imencode(".jpg", levels, [cv2.IMWRITE_JPEG_QUALITY, 100])[1].tobytes()
    exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x03\0\0\0\0\0\0"  # orientation 3: half a turn
    marked = data[:2] + b"\xff\xe1" + struct.pack(">H", 2 + len(exif)) + exif + data[2:]
    (scene / "images/c.png").unlink()
    (scene / "images/c.jpg").write_bytes(marked)
    path = scene / "sparse/images.bin"
    path.write_bytes(path.read_bytes().replace(b"c.png", b"c.jpg"))
    assert cv2.imdecode(np.frombuffer(marked, np.uint8), cv2.IMREAD_COLOR)[2, 2, 0] < 20
    image = load_scene(str(scene)).test[0].read("image")
    assert float(image[2].mean()) > 0.7
    assert float(image[-3].mean()) < 0.1


def cut(name: str, share: float) -> Callable[[Path], object]:
    def damage(folder: Path) -> None:
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data[: int(share * len(data))])

    return damage


def count_of(name: str) -> Callable[[Path], object]:
    return lambda f: (f / name).write_bytes(struct.pack("<Q", 1 << 60) + (f / name).read_bytes()[8:])


def stored(name: str, data: bytes) -> Callable[[Path], object]:
    return lambda f: (f / name).write_bytes(data)


def lens(*changes: tuple[int, float]) -> bytes:
    return cameras_file(lens=tuple(dict(changes).get(place, value) for place, value in enumerate(LENS)))


CAMERAS, IMAGES, POINTS = "sparse/cameras.bin", "sparse/images.bin", "sparse/points3D.bin"
NAN, INF = float("nan"), float("inf")
MISTAKES: dict[str, tuple[Callable[[Path], object], str]] = {
    "cameras cut off": (cut(CAMERAS, 0.7), "cameras.bin: it is cut off"),
    "cameras empty": (stored(CAMERAS, b""), "cameras.bin: it is cut off"),
    "images cut off": (cut(IMAGES, 0.8), "images.bin"),
    "an image's name has no end": (cut(IMAGES, 0.26), "images.bin"),
    "points cut off": (cut(POINTS, 0.8), "points3D.bin"),
    "absurd number of cameras": (count_of(CAMERAS), "it claims 1152921504606846976 records"),
    "absurd number of images": (count_of(IMAGES), "it claims 1152921504606846976 records"),
    "absurd number of points": (count_of(POINTS), "it claims 1152921504606846976 records"),
    "absurd number of features": (stored(IMAGES, images_file(features=1 << 50)), "a record claims"),
    "absurd length of a track": (stored(POINTS, points_file(track=1 << 62)), "a record claims"),
    "bytes after the last record": (stored(CAMERAS, cameras_file() + b"more"), "4 bytes follow its last record"),
    "a camera model that is none": (stored(CAMERAS, cameras_file(model=99)), "is of model number 99"),
    "a camera model that cannot be undistorted": (stored(CAMERAS, cameras_file(model=10)), "THIN_PRISM_FISHEYE"),
    "a camera without pixels": (stored(CAMERAS, cameras_file(width=0)), "0 x 30 pixels"),
    "a camera of 2^40 pixels": (stored(CAMERAS, cameras_file(width=1 << 40)), "1099511627776 x 30 pixels"),
    "a camera listed twice": (
        stored(CAMERAS, struct.pack("<Q", 2) + 2 * cameras_file()[8:]), "camera 7 is listed twice"
    ),
    "NaN focal length": (stored(CAMERAS, lens((0, NAN))), "finite and above zero"),
    "negative focal length": (stored(CAMERAS, lens((1, -5.0))), "finite and above zero"),
    "infinite principal point": (stored(CAMERAS, lens((2, INF))), "principal point must be finite"),
    "NaN distortion": (stored(CAMERAS, lens((4, NAN))), "must be finite"),
    "distortion of 1e300": (stored(CAMERAS, lens((5, 1e300))), "must be finite and at most 1e+06"),
    "distortion that leaves no image": (stored(CAMERAS, lens((4, -1e5))), "leaves no part of the image"),
    "a name that is not UTF-8": (stored(IMAGES, images_file(name=b"\xff\xfe.png")), "is not UTF-8"),
    "a name without a file": (stored(IMAGES, images_file(name=b"d.png")), "lacks 1 file: images/d.png"),
    "an image listed twice": (stored(IMAGES, images_file(name=b"c.png")), "image c.png is listed twice"),
    "one file under two names": (stored(IMAGES, images_file(name=b"./c.png")), "lists views twice"),
    "a camera that is not there": (stored(IMAGES, images_file(camera=8)), "has camera 8, which is not in the model"),
    "a quaternion of zeros": (stored(IMAGES, images_file(motion=(0.0,) * 7)), "is no rigid motion"),
    "a NaN translation": (stored(IMAGES, images_file(motion=(1, 0, 0, 0, NAN, 0, 0))), "is no rigid motion"),
    "a camera at 1e300": (stored(IMAGES, images_file(motion=(1, 0, 0, 0, 1e300, 0, 0))), "is no rigid motion"),
    "a point at 1e300": (stored(POINTS, points_file(x=1e300)), "1 of its points are not finite"),
    "a point that is NaN": (stored(POINTS, points_file(x=NAN)), "1 of its points are not finite"),
    "no images file": (lambda f: (f / IMAGES).unlink(), "it is incomplete"),
    "an image larger than its camera": (
        stored(CAMERAS, cameras_file(width=20, height=15)), "40 x 30 pixels, its camera 20 x 15"
    ),
    "an image of another shape": (stored(CAMERAS, cameras_file(width=60, height=60)), "its camera 60 x 60"),
}  # fmt: skip


def replaced(name: str, old: str, new: str) -> Callable[[Path], object]:
    return lambda f: (f / name).write_text((f / name).read_text().replace(old, new))


TEXT_MISTAKES: dict[str, tuple[Callable[[Path], object], str]] = {
    "too few parameters": (replaced("sparse/cameras.txt", " 0.002", ""), "OPENCV has 8 parameters, not 7"),
    "a size that is no number": (replaced("sparse/cameras.txt", " 40 ", " wide "), "line 2 cannot be understood"),
    "a size of 400 digits": (replaced("sparse/cameras.txt", " 40 ", f" {'9' * 400} "), "line 2 cannot be understood"),
    "a NaN parameter": (replaced("sparse/cameras.txt", "0.05", "nan"), "must be finite"),
    "a pose without a name": (replaced("sparse/images.txt", " 7 c.png", " 7"), "line 6 cannot be understood"),
    "a colour of 300": (replaced("sparse/points3D.txt", "255", "300"), "line 1 cannot be understood"),
    "text that is not UTF-8": (stored("sparse/images.txt", b"\xff\xfe\0"), "is not UTF-8 text"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", [*MISTAKES, *TEXT_MISTAKES])
def test_a_mistake_is_one_clear_error(mistake: str, scene: Path) -> None:
    if mistake in TEXT_MISTAKES:
        write_text(scene / "sparse")
    load_scene(str(scene))
    make, words = (MISTAKES | TEXT_MISTAKES)[mistake]
    make(scene)
    with pytest.raises(DataError) as caught:
        load_scene(str(scene))
    assert words in str(caught.value)
    assert caught.value.remedy
    assert len(str(caught.value).splitlines()) <= 3
