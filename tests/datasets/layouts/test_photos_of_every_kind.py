"""Photos, masks, depth and points as people bring them are read alike in every layout, or refused with a reason."""

import json
import struct
import zlib
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
import torch
from numpy.typing import NDArray
from PIL import Image, ImageCms, ImageOps
from scipy.spatial.transform import Rotation

from radiogs_core.errors import DataError
from radiogs_core.scene.colour import srgb_decode
from radiogs_core.scene.scene import Scene
from radiogs_datasets import load_scene
from radiogs_datasets.check import check_scene
from radiogs_datasets.options import SceneOptions

LAYOUTS = ("colmap", "blender", "llff")
VIEWS = 4
SIDE = 16
RANDOM = np.random.default_rng(7)
COLOURS = RANDOM.integers(20, 236, (SIDE, SIDE, 3), dtype=np.uint8)
COVERAGE = np.zeros((SIDE, SIDE), np.uint8)
COVERAGE[4:12, 3:13] = 255
COVERAGE[4:12, 3] = 128  # a soft edge
BY_CHANNELS = ([COVERAGE] * 3 + [0 * COVERAGE + 255], [0 * COVERAGE] * 3 + [COVERAGE])
"""Masks in four channels: opaque ones with coverage in their colours, and black ones with coverage in their alpha."""


def pose(number: float) -> NDArray[np.float64]:
    """Camera to world, OpenCV axes: on a circle of radius 4 around the origin, Z up."""
    angle = 0.7 * number
    forward = -np.array([np.cos(angle), np.sin(angle), 0.2]) / np.sqrt(1.04)
    right = np.cross(forward, [0, 0, 1]) / np.linalg.norm(np.cross(forward, [0, 0, 1]))
    matrix = np.eye(4)
    matrix[:3] = np.stack([right, np.cross(forward, right), forward, -4 * forward], -1)
    return matrix


Size = tuple[int, int]


def capture(folder: Path, layout: str, photo: bytes, name: str = "{}.png", size: Size = (SIDE, SIDE)) -> Path:
    """Photos with the same bytes, and their cameras, which are for ``size`` (width, height)."""
    if layout == "tensoir":
        return tensoir(folder, photo)
    (folder / "images").mkdir(parents=True)
    names, (width, height) = [name.format(number) for number in range(VIEWS)], size
    for each in names:
        (folder / "images" / each).write_bytes(photo)
    poses = [pose(number) for number in range(VIEWS)]
    if layout == "llff":
        hwf = np.array([height, width, 20.0])
        rows = [np.stack([m[:3, 1], m[:3, 0], -m[:3, 2], m[:3, 3], hwf], -1).ravel().tolist() for m in poses]
        np.save(folder / "poses_bounds.npy", np.array([[*row, 1.0, 9.0] for row in rows]))
    elif layout == "blender":
        lens = {"fl_x": 20.0, "fl_y": 20.0, "cx": width / 2, "cy": height / 2, "w": width, "h": height}
        frames = [
            {"file_path": f"images/{each}", "transform_matrix": (matrix * [1, -1, -1, 1]).tolist()}
            for each, matrix in zip(names, poses, strict=True)
        ]
        (folder / "transforms.json").write_text(json.dumps({**lens, "frames": frames}))
    else:
        model = folder / "sparse/0"
        model.mkdir(parents=True)
        (model / "cameras.txt").write_text(f"1 PINHOLE {width} {height} 20 20 {width / 2} {height / 2}\n")
        lines = []
        for number, (each, matrix) in enumerate(zip(names, poses, strict=True), start=1):
            x, y, z, w = Rotation.from_matrix(matrix[:3, :3].T).as_quat()
            motion = (w, x, y, z, *(-matrix[:3, :3].T @ matrix[:3, 3]))
            lines.append(f"{number} {' '.join(map(str, motion))} 1 {each}\n\n")
        (model / "images.txt").write_text("".join(lines))
        (model / "points3D.txt").write_text("")
    return folder


def tensoir(folder: Path, photo: bytes) -> Path:
    """The photos with a folder each, and their name whatever the bytes are."""
    for split in ("train", "test"):
        frames = []
        for number in range(VIEWS):
            place = folder / f"{split}_{number}"
            place.mkdir(parents=True)
            (place / "rgba.png").write_bytes(photo)
            matrix = pose(number + (split == "test") / 2) * [1, -1, -1, 1]
            frames.append({"file_path": f"{place.name}/rgba", "transform_matrix": matrix.tolist()})
        (folder / f"transforms_{split}.json").write_text(json.dumps({"camera_angle_x": 0.8, "frames": frames}))
    return folder


def encoded(image: NDArray, kind: str = "PNG", **options: object) -> bytes:
    data = BytesIO()
    Image.fromarray(image).save(data, kind, **options)
    return data.getvalue()


def exr(channels: dict[str, NDArray[np.float32]], folder: Path) -> bytes:
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, channels) as file:
        file.write(str(folder / "made.exr"))
    return (folder / "made.exr").read_bytes()


def masks(folder: Path, mask: bytes, ending: str = ".png") -> SceneOptions:
    (folder / "masks").mkdir()
    for number in range(VIEWS):
        (folder / "masks" / f"{number}{ending}").write_bytes(mask)
    return SceneOptions(mask_folder=str(folder / "masks"))


def said(scene: Scene, words: str) -> bool:
    return any(words in sentence for sentence in scene.repairs)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize(
    ("kind", "name", "usual"),
    [
        ("PNG", "{}.png", True),
        ("PNG", "{}.JPG", False),
        ("JPEG", "{}.png", False),
        ("JPEG", "{}.JPEG", True),
        ("WebP", "{}.webp", True),
        ("WebP", "{}.png", False),
        ("PNG", "{}.png.png", True),
    ],
)
def test_the_bytes_of_a_photo_tell_its_type(tmp_path: Path, layout: str, kind: str, name: str, usual: bool) -> None:
    data = encoded(COLOURS, kind.upper())
    scene = load_scene(str(capture(tmp_path / "a", layout, data, name)))
    assert np.allclose(scene.train[0].read("image").numpy() * 255, np.asarray(Image.open(BytesIO(data))), atol=1)
    assert said(scene, f"4 images are of type {kind}, unlike what their names say") != usual


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("kind", ["PNG", "JPEG", "PNG with tRNS", "palette", "16 bits"])
def test_grey_photos_are_read_as_red_green_and_blue(tmp_path: Path, layout: str, kind: str) -> None:
    grey, options = COLOURS[..., 0], {}
    image: NDArray = grey
    if kind == "16 bits":
        image = grey.astype(np.uint16) * 257
    if kind == "palette":
        data = BytesIO()
        Image.fromarray(grey).convert("P").save(data, "PNG")
        photo = data.getvalue()
    else:
        options = {"transparency": 7} if "tRNS" in kind else {"quality": 100} if kind == "JPEG" else {}
        photo = encoded(image, kind.split()[0] if not kind[0].isdigit() else "PNG", **options)
    scene = load_scene(str(capture(tmp_path / "a", layout, photo)))
    assert np.allclose(scene.train[0].read("image").numpy() * 255, grey[..., None].repeat(3, 2), atol=2)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("names", ["RGBA", "RGB", "YA", "ViewLayer.Combined.{}"])
def test_linear_photos_are_encoded_and_their_alpha_is_coverage(tmp_path: Path, layout: str, names: str) -> None:
    """OpenEXR's colours are multiplied by alpha; taken for display sRGB they were 16 dB from the right image."""
    display = torch.from_numpy(COLOURS / np.float32(255))
    alpha = COVERAGE.astype(np.float32) / 255 if "A" in names or "{}" in names else np.ones((SIDE, SIDE), np.float32)
    grey = names == "YA"
    linear = srgb_decode(display).numpy() * alpha[..., None]
    planes = {"R": linear[..., 0], "G": linear[..., 1], "B": linear[..., 2], "Y": linear[..., 1], "A": alpha}
    keys = "RGBA" if "{}" in names else names
    channels = {(names.format(key) if "{}" in names else key): np.ascontiguousarray(planes[key]) for key in keys}
    folder = capture(tmp_path / "a", layout, exr(channels, tmp_path), "{}.exr")
    scene = load_scene(str(folder))
    view = scene.train[0]
    wanted = display[..., 1:2].expand(-1, -1, 3) if grey else display
    seen = torch.from_numpy(alpha) > 0
    assert torch.allclose(view.read("image")[seen], wanted[seen], atol=1e-5)
    assert view.has("alpha") == (float(alpha.min()) == 0)
    assert not view.has("alpha") or np.allclose(view.read("alpha")[..., 0], alpha)
    assert said(scene, "4 photos hold linear radiance")
    assert check_scene(str(folder)).sound


@pytest.mark.parametrize("layout", [*LAYOUTS, "tensoir"])
@pytest.mark.parametrize("kind", ["RGBA", "WebP", "grey and alpha", "palette", "EXR", "16 bits"])
def test_alpha_of_photos_is_coverage(tmp_path: Path, layout: str, kind: str) -> None:
    rgba, wanted = np.dstack([COLOURS, COVERAGE]), COVERAGE
    if kind == "EXR":
        photo = exr(dict(zip("RGBA", np.float32(rgba / 255).transpose(2, 0, 1).copy(), strict=True)), tmp_path)
    elif kind == "16 bits":
        photo = cv2.imencode(".png", rgba.astype(np.uint16) * 257)[1].tobytes()
    elif kind == "palette":
        data = BytesIO()
        levels = Image.fromarray((COVERAGE > 200).astype(np.uint8), "P")
        levels.putpalette([9, 9, 9, 200, 100, 50])
        levels.save(data, "PNG", transparency=0)
        photo, wanted = data.getvalue(), np.where(COVERAGE > 200, 255, 0)
    else:
        image = np.dstack([COLOURS[..., 0], COVERAGE]) if "grey" in kind else rgba
        photo, wanted = encoded(image, "WEBP" if kind == "WebP" else "PNG", lossless=True), COVERAGE
    view = load_scene(str(capture(tmp_path / "a", layout, photo))).train[0]
    assert np.allclose(view.read("alpha")[..., 0] * 255, wanted)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_photos_some_of_which_have_alpha_are_refused_unless_it_is_opaque(tmp_path: Path, layout: str) -> None:
    folder = capture(tmp_path / "a", layout, encoded(COLOURS))
    (folder / "images/1.png").write_bytes(encoded(np.dstack([COLOURS, np.full_like(COVERAGE, 255)])))
    assert not load_scene(str(folder)).train[0].has("alpha")
    (folder / "images/1.png").write_bytes(encoded(np.dstack([COLOURS, COVERAGE])))
    with pytest.raises(DataError, match="has no alpha, other images of the scene have"):
        load_scene(str(folder))


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("flag", [5, 6, 7, 8])
@pytest.mark.parametrize("kind", ["JPEG", "PNG", "WEBP"])
def test_photos_are_turned_where_only_then_they_have_their_cameras_size(
    tmp_path: Path, layout: str, flag: int, kind: str
) -> None:
    """The expected pixels are Pillow's."""
    exif = Image.Exif()
    exif[0x0112] = flag
    smooth = np.kron(RANDOM.integers(0, 256, (3, 2, 3)), np.ones((4, 4, 1))).astype(np.uint8)
    photo = encoded(smooth, kind, exif=exif, **({"lossless": True} if kind == "WEBP" else {}))
    stored = Image.open(BytesIO(photo))
    upright, ending = np.asarray(ImageOps.exif_transpose(stored)), {"JPEG": "jpg", "PNG": "png", "WEBP": "webp"}[kind]
    folder = capture(tmp_path / "a", layout, photo, f"{{}}.{ending}", (12, 8))
    mask = np.zeros((8, 12), np.uint8)
    mask[2:, 3:] = 255
    scene = load_scene(str(folder), options=masks(folder, encoded(mask)))
    assert np.allclose(scene.train[0].read("image").numpy() * 255, upright, atol=2)
    assert np.array_equal(scene.train[0].read("alpha")[..., 0].numpy() * 255, mask)
    assert said(scene, f"4 images are of EXIF's orientation {flag}, which is applied")
    as_stored = load_scene(str(capture(tmp_path / "b", layout, photo, f"{{}}.{ending}", (8, 12))))
    assert np.allclose(as_stored.train[0].read("image").numpy() * 255, np.asarray(stored), atol=2)
    assert said(as_stored, f"4 images are of EXIF's orientation {flag}, which is not applied")


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize(
    ("mask", "words"),
    [
        (COVERAGE // 255, "of the levels 0 and 1"),
        (np.kron(np.arange(16), np.ones(16)).reshape(16, 16).astype(np.uint8) // 4, "of the levels 0 and 1, 2, 3"),
        (np.where(COVERAGE > 0, 200, 0).astype(np.uint8), "of the levels 0 and 200"),
        (np.where(COVERAGE > 0, 3, 0).astype(np.uint16), "of the levels 0 and 3"),
        (np.dstack([COVERAGE // 100] * 3), "of the levels 0 and 2"),
    ],
)
def test_masks_of_label_numbers_are_refused(tmp_path: Path, layout: str, mask: NDArray, words: str) -> None:
    folder = capture(tmp_path / "a", layout, encoded(COLOURS))
    options = masks(folder, encoded(mask))
    with pytest.raises(DataError, match=words) as caught:
        load_scene(str(folder), options=options)
    assert "Write " in caught.value.remedy
    assert not check_scene(str(folder), options).sound


def profile(gamma: float) -> bytes:
    """An RGB profile with sRGB's primaries and a power for its curve."""
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    place = srgb.index(b"para", 128)
    return srgb[:place] + b"curv" + struct.pack(">IIH", 0, 1, round(256 * gamma)) + srgb[place + 14 :]


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("said_of_colour", ["srgb", "power", "gamma", "cicp"])
def test_a_mask_is_numbers_whatever_its_colour_profile(tmp_path: Path, layout: str, said_of_colour: str) -> None:
    folder = capture(tmp_path / "a", layout, encoded(COLOURS))
    plain = encoded(COVERAGE)
    if said_of_colour in ("srgb", "power"):
        srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
        mask = encoded(COVERAGE, icc_profile=srgb if said_of_colour == "srgb" else profile(1.0))
    else:
        name, body = (b"gAMA", struct.pack(">I", 100000)) if said_of_colour == "gamma" else (b"cICP", b"\t\x10\0\1")
        chunk = struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        mask = plain[:33] + chunk + plain[33:]
    options = masks(folder, mask)
    assert np.array_equal(load_scene(str(folder), options=options).train[0].read("alpha")[..., 0] * 255, COVERAGE)
    assert check_scene(str(folder), options).sound
    if said_of_colour != "srgb" and said_of_colour != "power":
        (folder / "images/1.png").write_bytes(mask)
        with pytest.raises(DataError, match="is not in sRGB"):
            load_scene(str(folder))


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("mask", [COVERAGE, *(np.dstack(each) for each in BY_CHANNELS)])
@pytest.mark.parametrize("ending", [".png", ".PNG", ".png.png", "_mask.webp"])
def test_masks_say_the_same_as_levels_or_as_alpha(tmp_path: Path, layout: str, mask: NDArray, ending: str) -> None:
    folder = capture(tmp_path / "a", layout, encoded(COLOURS))
    scene = load_scene(str(folder), options=masks(folder, encoded(mask), ending))
    assert np.array_equal(scene.train[0].read("alpha")[..., 0] * 255, COVERAGE)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("factor", [2, 4])
def test_masks_of_the_full_size_are_reduced_with_their_photos(tmp_path: Path, layout: str, factor: int) -> None:
    folder = capture(tmp_path / "a", layout, encoded(COLOURS))
    small = np.asarray(Image.fromarray(COLOURS).reduce(factor))
    (folder / f"images_{factor}").mkdir()
    for path in (folder / "images").iterdir():
        (folder / f"images_{factor}" / path.name).write_bytes(encoded(small))
        if layout == "blender":
            path.unlink()
    options = masks(folder, encoded(COVERAGE))
    view = load_scene(str(folder), options=options).train[0]
    side = SIDE // factor
    wanted = COVERAGE.reshape(side, factor, side, factor).mean((1, 3)) / 255
    assert np.allclose(view.read("alpha")[..., 0], wanted, atol=1e-6)
    assert (view.camera.width, view.camera.fx, view.camera.cx) == (side, 20 / factor, side / 2)
    ignored = load_scene(str(folder), options=SceneOptions(mask_folder=options.mask_folder, masks="ignore")).train[0]
    assert np.array_equal(ignored.read("valid")[..., 0] > 0, wanted > 0.999 if factor == 2 else wanted > 0.8)


def rewritten(folder: Path, change: Callable[[dict], object]) -> Scene:
    table = json.loads((folder / "transforms.json").read_text())
    change(table)
    (folder / "transforms.json").write_text(json.dumps(table))
    return load_scene(str(folder))


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("mask", [0 * COVERAGE + 255, np.dstack([0 * COVERAGE + 255] * 4)])
def test_a_mask_that_alone_is_opaque_is_named_by_the_check(tmp_path: Path, layout: str, mask: NDArray) -> None:
    folder = capture(tmp_path / "a", layout, encoded(COLOURS))
    options = masks(folder, encoded(COVERAGE))
    (folder / "masks/2.png").write_bytes(encoded(mask))
    found = [finding for finding in check_scene(str(folder), options).findings if "1 throughout" in finding.what]
    assert len(found) == 1
    assert "2" in found[0].place


def test_views_without_a_mask_are_named(tmp_path: Path) -> None:
    folder = capture(tmp_path / "a", "blender", encoded(COLOURS))
    (folder / "m.png").write_bytes(encoded(COVERAGE))
    scene = rewritten(folder, lambda table: [frame.update(mask_path="m.png") for frame in table["frames"][:2]])
    assert said(scene, "2 of 4 photos have no mask, and every pixel of them counts: images/2, images/3")


@pytest.mark.parametrize("written", ["images/{}.png", "images_2/{}.png", "./images_2/{}.png"])
def test_transforms_find_reduced_photos_by_paths_as_written_or_edited(tmp_path: Path, written: str) -> None:
    folder = capture(tmp_path / "a", "blender", encoded(np.asarray(Image.fromarray(COLOURS).reduce(2))))
    (folder / "images").rename(folder / "images_2")
    scene = rewritten(
        folder,
        lambda table: [frame.update(file_path=written.format(place)) for place, frame in enumerate(table["frames"])],
    )
    assert (scene.train[0].camera.width, scene.train[0].camera.fx, scene.train[0].camera.cy) == (8, 10, 4)
    words = "4 written paths are in a folder that lacks photos: images_2/ has all"
    assert said(scene, words) == ("_2" not in written)


@pytest.mark.parametrize("kind", ["png", "npy"])
@pytest.mark.parametrize("factor", [0.5, 1, 2])
def test_coarse_depth_is_left_out_and_fine_depth_sampled_at_the_nearest(
    tmp_path: Path, kind: str, factor: float
) -> None:
    folder, side = capture(tmp_path / "a", "blender", encoded(COLOURS)), int(SIDE * factor)
    depth = RANDOM.integers(1, 9000, (side, side)).astype(np.uint16)
    if kind == "png":
        (folder / "d.png").write_bytes(encoded(depth))
    else:
        np.save(folder / "d.npy", depth)
    scene = rewritten(folder, lambda table: [frame.update(depth_file_path=f"d.{kind}") for frame in table["frames"]])
    view = scene.train[0]
    assert view.has("depth") == (factor >= 1)
    assert said(scene, "depth maps of 4 photos are smaller than they are, and left out") == (factor < 1)
    if factor == 1:
        assert np.allclose(view.read("depth")[..., 0], depth * 1e-3)
    elif factor == 2:
        levels = np.rint(view.read("depth")[..., 0].numpy() * 1e3)
        blocks = depth.reshape(SIDE, 2, SIDE, 2).swapaxes(1, 2).reshape(SIDE, SIDE, 4)
        assert (levels[..., None] == blocks).any(-1).all()


def ply(colour: str, *names: str) -> bytes:
    head = "ply\nformat ascii 1.0\nelement vertex 2\n" + "".join(f"property double {name}\n" for name in "xyz")
    value = {"uchar": 51, "ushort": 13107, "float": 0.2, "double": 51.0, "int": 51}.get(colour, "")
    high = {"uchar": 255, "ushort": 65535, "float": 1.0, "double": 255.0, "int": 255}.get(colour, "")
    head += "".join(f"property {colour} {name}\n" for name in names) + "end_header\n"
    rows = (("0 1 2", value), ("3 4 5", high))
    return (head + "".join(f"{place} {' '.join([str(level)] * len(names))}\n" for place, level in rows)).encode()


@pytest.mark.parametrize("layout", ["colmap", "blender"])
@pytest.mark.parametrize("colour", ["uchar", "ushort", "float", "double", "int", "none"])
def test_start_points_of_any_colours_are_read(tmp_path: Path, layout: str, colour: str) -> None:
    folder = capture(tmp_path / "a", layout, encoded(COLOURS))
    names = () if colour == "none" else ("r", "g", "b") if colour == "int" else ("red", "green", "blue")
    if layout == "colmap":
        (folder / "sparse/0/points3D.txt").unlink()
        (folder / "sparse/0/points3D.ply").write_bytes(ply(colour, *names))
        scene = load_scene(str(folder))
    else:
        (folder / "p.ply").write_bytes(ply(colour, *names))
        scene = rewritten(folder, lambda table: table.update(ply_file_path="p.ply"))
    assert scene.points is not None
    assert scene.points.positions.tolist() == [[0, 1, 2], [3, 4, 5]]
    assert torch.allclose(scene.points.colours[0], torch.full((3,), 0.5 if colour == "none" else 0.2))
    assert said(scene, "have no colours: grey is taken" if colour == "none" else "are of type") == (colour != "uchar")


@pytest.mark.parametrize(
    ("layout", "points", "lacks"),
    [
        ("colmap", None, "no points3D file, or no point in it: surfels start without points"),
        ("colmap", "# none", "no points3D file, or no point in it: surfels start without points"),
        ("blender", None, "p.ply is not there: surfels start without its points"),
    ],
)
def test_absent_start_points_stop_nothing(tmp_path: Path, layout: str, points: str | None, lacks: str) -> None:
    folder = capture(tmp_path / "a", layout, encoded(COLOURS))
    if layout == "blender":
        scene = rewritten(folder, lambda table: table.update(ply_file_path="p.ply"))
    else:
        path = folder / "sparse/0/points3D.txt"
        path.unlink() if points is None else path.write_text(points)
        scene = load_scene(str(folder))
    assert scene.points is None
    assert said(scene, lacks)


@pytest.mark.parametrize("name", ["camera_linear_velocity", "camera_angular_velocity", "pose_acceleration"])
def test_fields_on_the_cameras_motion_are_ignored_with_a_remark(tmp_path: Path, name: str) -> None:
    folder = capture(tmp_path / "a", "blender", encoded(COLOURS))
    scene = rewritten(folder, lambda table: [frame.update({name: [0.1, 0.2, 0.3]}) for frame in table["frames"]])
    assert said(scene, f"not used: {name}")


@pytest.mark.parametrize("data", [b"II*\0" + bytes(60), b"\0\0\0\x18ftypheic" + bytes(60), b"GIF89a" + bytes(60)])
def test_other_types_are_named_with_what_to_do(tmp_path: Path, data: bytes) -> None:
    folder = capture(tmp_path / "a", "blender", encoded(COLOURS))
    (folder / "images/2.png").write_bytes(data)
    with pytest.raises(DataError, match=r"is of type (TIFF|HEIC or AVIF|GIF)") as caught:
        load_scene(str(folder))
    assert "Save it as PNG" in caught.value.remedy
