"""Metadata of an image file is applied, or refused by name; it is never dropped."""

import io
import os
import struct
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
import pytest
import torch
from numpy.typing import NDArray
from PIL import Image, ImageCms

from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.colour import srgb_encode
from radiogs_datasets import bounded_reading
from radiogs_datasets.bounded_reading import IMAGE_LIMIT, read_bytes, read_json, read_numpy
from radiogs_datasets.image_files import read_exr, read_image, write_exr
from radiogs_datasets.image_structure import png_layout

LEVELS = np.random.default_rng(0).integers(0, 256, (6, 8, 3), np.uint8)


def exr(path: Path, names: Iterable[str], size: tuple[int, int] = (2, 3), **header: object) -> Path:
    """A file whose n-th channel is n throughout."""
    channels = {name: np.full(size, place, np.float32) for place, name in enumerate(names)}
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | header, channels) as f:
        f.write(str(path))
    return path


def chunk(name: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


def png_with(path: Path, *chunks: bytes, image: Image.Image | None = None) -> Path:
    """A PNG of LEVELS with chunks after its header."""
    stream = io.BytesIO()
    (image or Image.fromarray(LEVELS)).save(stream, "PNG")
    data = stream.getvalue()
    path.write_bytes(data[:33] + b"".join(chunks) + data[33:])
    return path


def jpeg(path: Path, **options: object) -> Path:
    smooth = cv2.GaussianBlur(np.random.default_rng(1).integers(0, 256, (64, 96, 3), np.uint8), (9, 9), 0)
    Image.fromarray(smooth).save(path, "JPEG", quality=95, **options)
    return path


@pytest.mark.parametrize(
    ("names", "wanted"),
    [
        ("RGB", [0, 1, 2]),
        ("BGRA", [2, 1, 0, 3]),
        ("rgb", [0, 1, 2]),
        ([f"ViewLayer.Combined.{name}" for name in "ABGR"], [3, 2, 1, 0]),
        (["R", "G", "B", "ViewLayer.Depth.Z", "Normal.X"], [0, 1, 2]),
        ("AZ", [1]),
        ("Y", [0]),
        ("V", [0]),
        (["depth.T"], [0]),
        (["Normal.Z", "Normal.X", "Normal.Y"], [1, 2, 0]),
    ],
)
def test_exr_channels_go_by_their_names(tmp_path: Path, names: Iterable[str], wanted: list[int]) -> None:
    """Audit M2: ViewLayer.Combined became A, B, G; r, g, b became B, G, R; depth with {A, Z} read A."""
    assert read_exr(exr(tmp_path / "a.exr", names))[0, 0].tolist() == wanted


@pytest.mark.parametrize(
    "names",
    ["RA", "RG", "GB", "PQ", ["a.R", "a.G", "a.B", "b.R", "b.G", "b.B"], ["Y", "RY", "BY"], ["Y", "a.R", "a.G", "a.B"]],
)
def test_ambiguous_exr_channels_are_refused_by_name(tmp_path: Path, names: Iterable[str]) -> None:
    """Audit M2: R and A without G and B were read as an image of two channels."""
    with pytest.raises(DataError, match="channels") as caught:
        read_exr(exr(tmp_path / "a.exr", names))
    assert all(name in caught.value.what for name in names)


def test_exr_parts_are_refused_by_name(tmp_path: Path) -> None:
    """Audit M2: the first part of a multi-part file was read, whatever it was."""
    one = {name: np.ones((2, 3), np.float32) for name in "RGB"}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File([OpenEXR.Part(dict(header), one, "beauty"), OpenEXR.Part(dict(header), one, "albedo")]).write(
        str(tmp_path / "a.exr")
    )
    with pytest.raises(DataError, match="2 parts: beauty, albedo"):
        read_exr(tmp_path / "a.exr")


def test_exr_of_a_cropped_window_or_other_primaries_is_refused(tmp_path: Path) -> None:
    """Issue 29, item 1: a window moves the principal point, primaries change every colour."""
    aces = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)
    with pytest.raises(DataError, match="primaries"):
        read_exr(exr(tmp_path / "aces.exr", "RGB", chromaticities=aces))
    whole = (np.zeros(2, np.int32), np.array([9, 9], np.int32))
    with pytest.raises(DataError, match="window"):
        read_exr(exr(tmp_path / "crop.exr", "RGB", displayWindow=whole))
    srgb = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
    assert read_exr(exr(tmp_path / "srgb.exr", "RGB", chromaticities=srgb)).shape == (2, 3, 3)


@pytest.mark.parametrize("ending", [".jpg", ".png"])
def test_orientation_in_exif_is_ignored_as_cameras_are_for_stored_pixels(tmp_path: Path, ending: str) -> None:
    """Audit M3: EXIF's orientation turned the image and not the camera."""
    exif = Image.Exif()
    exif[0x0112] = 6
    stored = Image.fromarray(LEVELS)
    for name, options in (("plain", {}), ("turned", {"exif": exif.tobytes()})):
        stored.save(tmp_path / f"{name}{ending}", **options)
    assert b"Exif" in (tmp_path / f"turned{ending}").read_bytes() or ending == ".png"
    plain, turned = (read_image(tmp_path / f"{name}{ending}") for name in ("plain", "turned"))
    assert np.array_equal(plain, turned)
    assert plain.shape[:2] == LEVELS.shape[:2]


def test_transparency_of_palettes_and_keys_is_kept(tmp_path: Path) -> None:
    """Audit M11: palette PNGs and tRNS lost their transparency, so that every pixel counted as covered."""
    paletted = Image.fromarray(LEVELS).quantize(4)
    places = np.asarray(paletted)
    paletted.save(tmp_path / "palette.png", transparency=bytes([0, 128, 255, 255]))
    key = LEVELS[2, 3]
    Image.fromarray(LEVELS).save(tmp_path / "rgb.png", transparency=tuple(int(level) for level in key))
    Image.fromarray(LEVELS[..., 0]).save(tmp_path / "grey.png", transparency=int(key[0]))
    shades = read_image(tmp_path / "palette.png")[..., 3] * 255
    assert np.array_equal(shades.round(), np.array([0, 128, 255, 255])[places])
    grey, colour = read_image(tmp_path / "grey.png"), read_image(tmp_path / "rgb.png")
    assert np.array_equal(grey[..., 3] == 0, LEVELS[..., 0] == key[0])
    assert np.allclose(grey[..., 0] * 255, LEVELS[..., 0])
    assert np.array_equal(colour[..., 3] == 0, (key == LEVELS).all(-1))
    for name in ("palette.png", "rgb.png", "grey.png"):
        assert png_layout(Path(name), (tmp_path / name).read_bytes()).transparent


def test_a_grey_key_of_few_bits_is_kept(tmp_path: Path) -> None:
    """Audit M11: two-bit levels are spread to eight before they are compared with the key."""
    rows = b"".join(b"\0" + bytes([0b00011011]) for _ in range(4))
    header = struct.pack(">IIBBBBB", 4, 4, 2, 0, 0, 0, 0)
    (tmp_path / "a.png").write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"tRNS", struct.pack(">H", 2))
        + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    )  # fmt: skip
    assert read_image(tmp_path / "a.png")[0, :, 3].tolist() == [1, 1, 0, 1]


def test_damage_within_a_jpegs_scan_is_an_error(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Audit M14: JPEGs with a damaged scan, or cut short and closed, were read."""
    whole = jpeg(tmp_path / "a.jpg").read_bytes()
    assert read_image(tmp_path / "a.jpg").shape == (64, 96, 3)
    half = len(whole) // 2
    damage = bytes(255 - byte if byte not in (0, 255) else byte for byte in whole[half : half + 40])
    for data in (whole[:half] + b"\xff\xd9", whole[:half] + damage + whole[half + 40 :]):
        (tmp_path / "b.jpg").write_bytes(data)
        with pytest.raises(DataError, match="damaged: libjpeg says"):
            read_image(tmp_path / "b.jpg")
    assert capfd.readouterr().err == ""


def test_output_of_others_while_a_jpeg_is_decoded_is_not_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Audit M14: libjpeg's warnings are read from standard error, which others use as well."""
    jpeg(tmp_path / "a.jpg")
    decode = cv2.imdecode

    def beside(data: NDArray[np.uint8], flags: int) -> NDArray[np.uint8]:
        os.write(2, b"step 3 of 5\n")
        return np.asarray(decode(data, flags))

    monkeypatch.setattr(cv2, "imdecode", beside)
    read_image(tmp_path / "a.jpg")
    os.write(2, b"step 4 of 5\n")
    assert capfd.readouterr().err == "step 3 of 5\nstep 4 of 5\n"


def test_damaged_pixels_of_an_exr_are_an_error_and_nothing_is_printed(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """OpenEXR prints its complaints to both streams, and may still return pixels."""
    generator = np.random.default_rng(0)
    write_exr(tmp_path / "a.exr", generator.random((64, 64, 3)).astype(np.float32))
    whole = (tmp_path / "a.exr").read_bytes()
    for _ in range(40):
        damage = bytearray(whole)
        for place in generator.integers(len(whole) // 4, len(whole), 3):
            damage[place] ^= 0x5A
        (tmp_path / "b.exr").write_bytes(bytes(damage))
        with pytest.raises(DataError, match=r"damaged: OpenEXR says|NaN|infin"):
            read_exr(tmp_path / "b.exr")
    assert capfd.readouterr() == ("", "")


def test_openexrs_complaints_are_errors_even_if_it_returns_pixels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    write_exr(tmp_path / "a.exr", np.ones((4, 4, 3), np.float32))
    opened = OpenEXR.File

    def complaining(*arguments: Any, **options: Any) -> Any:
        os.write(2, b"step 3 of 5\nb.exr: (EXR_ERR_CORRUPT_CHUNK) Unable to decompress\n")
        return opened(*arguments, **options)

    monkeypatch.setattr(OpenEXR, "File", complaining)
    with pytest.raises(DataError, match="EXR_ERR_CORRUPT_CHUNK"):
        read_exr(tmp_path / "a.exr")
    assert capfd.readouterr() == ("", 2 * "step 3 of 5\n"), "the file is opened twice"


def test_an_animated_png_is_refused(tmp_path: Path) -> None:
    """Audit M16: of an APNG the default image was read, which need not be a frame."""
    frames = [Image.fromarray(LEVELS), Image.fromarray(255 - LEVELS)]
    frames[0].save(tmp_path / "a.png", save_all=True, append_images=frames[1:], default_image=True)
    with pytest.raises(DataError, match="APNG"):
        read_image(tmp_path / "a.png")


def numbers(*values: int) -> bytes:
    return struct.pack(f">{len(values)}I", *values)


@pytest.mark.parametrize(
    ("said", "what"),
    [
        (chunk(b"gAMA", numbers(100_000)), "gAMA chunk says 1"),
        (chunk(b"cHRM", numbers(31270, 32900, 68000, 32000, 26500, 69000, 15000, 6000)), "cHRM"),
        (chunk(b"cICP", b"\x09\x10\x00\x01"), "cICP"),
        (chunk(b"iCCP", b"name\0\0not a profile"), "ICC"),
        (chunk(b"iCCP", b"name\0\0" + zlib.compress(b"not a profile")), "ICC"),
    ],
)
def test_colours_that_are_not_srgb_are_refused_by_name(tmp_path: Path, said: bytes, what: str) -> None:
    """Issue 29, item 1: gAMA, cHRM, cICP and ICC profiles change what is seen."""
    with pytest.raises(DataError, match=what):
        read_image(png_with(tmp_path / "a.png", said))


def test_images_marked_as_srgb_are_read_unchanged(tmp_path: Path) -> None:
    """Issue 29, item 1: most encoders write these; an sRGB chunk or profile goes before gAMA."""
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    primaries = chunk(b"cHRM", numbers(31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000))
    for said in (
        chunk(b"gAMA", numbers(45455)) + primaries,
        chunk(b"sRGB", b"\0") + chunk(b"gAMA", numbers(100_000)),
        chunk(b"iCCP", b"sRGB\0\0" + zlib.compress(srgb)),
        chunk(b"cICP", b"\x01\x0d\x00\x01") + chunk(b"gAMA", numbers(100_000)),
    ):
        assert np.allclose(read_image(png_with(tmp_path / "a.png", said)) * 255, LEVELS)
    jpeg(tmp_path / "plain.jpg")
    jpeg(tmp_path / "srgb.jpg", icc_profile=srgb)
    assert np.array_equal(read_image(tmp_path / "plain.jpg"), read_image(tmp_path / "srgb.jpg"))


def adobe_like(red: tuple[float, float]) -> bytes:
    """sRGB's profile with another red: its ``rXYZ`` tag is overwritten."""
    profile = bytearray(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    place = bytes(profile).index(b"rXYZ", 128)
    (offset,) = struct.unpack_from(">I", profile, place + 4)
    struct.pack_into(">3i", profile, offset + 8, round(red[0] * 65536), round(red[1] * 65536), 0x0200)
    return bytes(profile)


def test_a_profile_that_is_not_srgb_is_applied(tmp_path: Path) -> None:
    """Issue 29, item 1: a photo in another space than sRGB is converted, and one of 16 bits refused."""
    profile = adobe_like((0.6, 0.3))
    jpeg(tmp_path / "plain.jpg")
    jpeg(tmp_path / "wide.jpg", icc_profile=profile)
    plain, wide = read_image(tmp_path / "plain.jpg"), read_image(tmp_path / "wide.jpg")
    # More light in red's tag: the same levels stand for more red, and little else changes but where it is clipped.
    assert float((wide - plain)[..., 0].mean()) > 0.05
    cv2.imwrite(str(tmp_path / "deep.png"), LEVELS.astype(np.uint16) * 257)
    data = (tmp_path / "deep.png").read_bytes()
    (tmp_path / "deep.png").write_bytes(data[:33] + chunk(b"iCCP", b"x\0\0" + zlib.compress(profile)) + data[33:])
    with pytest.raises(DataError, match="16 bits"):
        read_image(tmp_path / "deep.png")


def test_a_grey_image_with_an_srgb_like_colour_profile_is_read(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Pillow keeps a photo's profile in the grey mask made of it: 66 masks of a public capture were refused for it."""
    grey = Image.fromarray(LEVELS).convert("L")
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    grey.save(tmp_path / "mask.png", icc_profile=srgb)
    assert np.allclose(read_image(tmp_path / "mask.png")[..., 0] * 255, np.asarray(grey))
    assert capfd.readouterr().err == "", "libpng warns of each such file"
    curve = srgb.index(b"para", 128)
    linear = srgb[:curve] + b"curv" + bytes(8) + srgb[curve + 12 :]
    grey.save(tmp_path / "linear.png", icc_profile=linear)
    shown = srgb_encode(torch.from_numpy(np.asarray(grey) / 255)).numpy()  # R, G and B through the profile
    assert np.allclose(read_image(tmp_path / "linear.png"), shown[..., None].repeat(3, 2), atol=1.5 / 255)
    assert np.allclose(read_image(tmp_path / "linear.png", numbers=True)[..., 0] * 255, np.asarray(grey))


def large_png(path: Path, side: int) -> Path:
    rows = zlib.compress((b"\0" + bytes(side)) * side)
    header = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    )  # fmt: skip
    return path


def test_pixels_are_bounded_before_they_are_decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Audit M31, M32: 1 MB of PNG took 11.9 GB and 188 s, a light of 8192 x 16384 7.2 GB and 118 s."""
    header = struct.pack(">IIBBBBB", 16384, 16384, 8, 2, 0, 0, 0)
    (tmp_path / "huge.png").write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", bytes(1 << 20)) + chunk(b"IEND", b"")
    )
    (tmp_path / "huge.hdr").write_bytes(b"#?RADIANCE\n\n-Y 8192 +X 16384\n" + bytes(1 << 20))
    for name in ("huge.png", "huge.hdr"):
        with pytest.raises(DataError, match=IMAGE_LIMIT):
            read_image(tmp_path / name)
    monkeypatch.setenv(IMAGE_LIMIT, "400")
    small = large_png(tmp_path / "small.png", 20)
    write_exr(tmp_path / "many.exr", np.ones((20, 20, 3)))
    assert read_image(small).shape == (20, 20, 1)
    assert read_image(tmp_path / "many.exr").shape == (20, 20, 3)
    exr(tmp_path / "layers.exr", [*"RGB", "a.X", "b.X"], (20, 20))
    for path in (large_png(tmp_path / "large.png", 21), tmp_path / "layers.exr"):
        with pytest.raises(DataError, match=IMAGE_LIMIT):
            read_image(path)
    monkeypatch.setenv(IMAGE_LIMIT, "441")
    assert read_image(tmp_path / "large.png").shape == (21, 21, 1)
    monkeypatch.setenv(IMAGE_LIMIT, "many")
    with pytest.raises(UsageError, match="many"):
        read_image(small)


@pytest.mark.parametrize("ending", ["png", "jpg", "exr", "hdr"])
def test_pipes_devices_and_folders_are_refused_at_once(tmp_path: Path, ending: str) -> None:
    """Audit M33: a named pipe was waited for, /dev/zero filled memory."""
    os.mkfifo(tmp_path / f"pipe.{ending}")
    (tmp_path / f"zero.{ending}").symlink_to("/dev/zero")
    (tmp_path / f"folder.{ending}").mkdir()
    for name in ("pipe", "zero", "folder"):
        with pytest.raises(DataError, match=r"a named pipe|a device|a folder"):
            read_image(tmp_path / f"{name}.{ending}")


def test_large_files_are_refused_unread(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Audit M33: a sparse file of terabytes is refused by its size."""
    with (tmp_path / "a.png").open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(DataError, match="RADIOGS_BENCH_LARGEST_FILE"):
        read_image(tmp_path / "a.png")
    monkeypatch.setenv("RADIOGS_BENCH_LARGEST_FILE", "3")
    (tmp_path / "b").write_bytes(b"abcd")
    with pytest.raises(DataError, match="=4"):
        read_bytes(tmp_path / "b")


@pytest.mark.parametrize("name", ["x" * 300, "a\0b", "\udc80", "\ud800x"])
def test_names_that_the_system_cannot_hold_are_refused(tmp_path: Path, name: str) -> None:
    """Audit M23: paths over 255 characters and lone surrogates ended in tracebacks."""
    with pytest.raises(DataError, match="cannot read") as caught:
        read_bytes(tmp_path / name)
    caught.value.what.encode()


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("[" * 100_000 + "]" * 100_000, "nested"),
        ('{"a":' * 100 + "1" + "}" * 100, "nested"),
        ("1" * 5000, "digits"),
        ("1." + "0" * 5000, "digits"),
        ('"\\ud800"', "surrogates"),
        ('{"a": 1,}', "JSON"),
    ],
)
def test_json_is_bounded(tmp_path: Path, text: str, what: str) -> None:
    """Audit M23: depth, digits and constants of JSON."""
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(DataError, match=what):
        read_json(tmp_path / "a.json")


def test_brackets_within_text_are_no_depth(tmp_path: Path) -> None:
    """Audit M23: the bound counts open brackets, but not quoted ones."""
    (tmp_path / "a.json").write_text('["' + "[" * 1000 + '\\"{[", "\\ud83d\\ude00", ' + "[[1, 2.5]], " * 500 + "0]")
    assert read_json(tmp_path / "a.json")[:2] == ["[" * 1000 + '"{[', "\U0001f600"]


def test_numpy_files_hold_what_their_header_claims(tmp_path: Path) -> None:
    """Audit M23: a header of terabytes; M12: pickled objects stay unread."""
    np.save(tmp_path / "a.npy", np.arange(6.0).reshape(2, 3))
    data = (tmp_path / "a.npy").read_bytes()
    (tmp_path / "b.npy").write_bytes(data.replace(b"(2, 3), ", b"(9999999999999, 3), ".ljust(8)))
    np.save(tmp_path / "c.npy", np.array([None, 1]), allow_pickle=True)
    (tmp_path / "d.npy").write_bytes(data[:-8])
    assert read_numpy(tmp_path / "a.npy").tolist() == [[0, 1, 2], [3, 4, 5]]
    for name in "bcd":
        with pytest.raises(DataError, match="cannot read"):
            read_numpy(tmp_path / f"{name}.npy")


def test_numbers_beyond_float32_are_refused(tmp_path: Path) -> None:
    """Audit M12: float64 1e300 became infinite after it had been tested."""
    values: NDArray[np.float64] = np.array([[1.0, 1e300]])
    with pytest.raises(DataError, match="beyond"):
        bounded_reading.as_float32(tmp_path / "a.npy", values)


def test_a_light_beyond_half_floats_is_written_in_full(tmp_path: Path) -> None:
    """Audit M34: a radiance of 1e6 (a real sun) ended in 'half floats end at 65504' after other files were written."""
    sun = np.full((2, 4, 3), 0.1, np.float32)
    sun[0, 0] = 1e6
    write_exr(tmp_path / "a.exr", sun)
    assert np.array_equal(read_exr(tmp_path / "a.exr"), sun)
