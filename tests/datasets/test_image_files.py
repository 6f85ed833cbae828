"""Image files come back as they were written, in every type that scenes use; damaged ones are errors."""

import struct
import zlib
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from radiogs_core.errors import DataError
from radiogs_datasets.image_files import LOGGING, read_exr, read_hdr, read_image, write_exr, write_hdr, write_png
from radiogs_datasets.image_structure import image_header

RANDOM = np.random.default_rng(0)


def chunk(name: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


def png(width: int, height: int, pixels: bytes, colour: int = 6, bits: int = 8, interlaced: int = 0) -> bytes:
    header = struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, interlaced)
    stream = zlib.compress(pixels)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", stream) + chunk(b"IEND", b"")


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_png_round_trip_is_exact_in_eight_bits(tmp_path: Path, channels: int) -> None:
    levels = RANDOM.integers(0, 256, (5, 7, channels))
    write_png(tmp_path / "a.png", levels / 255)
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), (levels / 255).astype(np.float32))


@pytest.mark.parametrize(("mode", "channels"), [("L", 1), ("RGB", 3), ("RGBA", 4)])
def test_png_channels_are_in_the_order_that_pillow_has(tmp_path: Path, mode: str, channels: int) -> None:
    levels = RANDOM.integers(0, 256, (5, 7, channels), dtype=np.uint8)
    Image.fromarray(levels.squeeze(), mode).save(tmp_path / "a.png")
    np.testing.assert_array_equal(np.rint(read_image(tmp_path / "a.png") * 255), levels)


def test_png_with_palette_is_read_as_its_colours(tmp_path: Path) -> None:
    colours = Image.fromarray(RANDOM.integers(0, 2, (6, 5, 3), dtype=np.uint8) * 255, "RGB")
    colours.quantize(8).save(tmp_path / "a.png")
    np.testing.assert_array_equal(read_image(tmp_path / "a.png") * 255, np.asarray(colours))


def test_sixteen_bit_rgba_keeps_all_its_bits(tmp_path: Path) -> None:
    levels = RANDOM.integers(0, 1 << 16, (6, 5, 4), dtype=np.uint16)
    lines = b"".join(b"\0" + line.astype(">u2").tobytes() for line in levels)
    (tmp_path / "a.png").write_bytes(png(5, 6, lines, bits=16))
    np.testing.assert_allclose(read_image(tmp_path / "a.png") * 65535, levels, rtol=1e-7)


def test_interlaced_png_is_read(tmp_path: Path) -> None:
    """Seven passes of a 3 x 2 image: columns (0), -, -, (2), -, (1), row 1; passes without pixels have no lines."""
    grey = {1: [10], 4: [30], 6: [20], 7: [40, 50, 60]}
    (tmp_path / "a.png").write_bytes(png(3, 2, b"".join(b"\0" + bytes(values) for values in grey.values()), 0, 8, 1))
    np.testing.assert_array_equal(np.rint(read_image(tmp_path / "a.png")[..., 0] * 255), [[10, 20, 30], [40, 50, 60]])


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_exr_round_trip_is_exact_in_half_floats(tmp_path: Path, channels: int) -> None:
    image = np.exp(RANDOM.normal(0, 3, (9, 5, channels))).astype(np.float16)
    write_exr(tmp_path / "a.exr", image)
    np.testing.assert_array_equal(read_exr(tmp_path / "a.exr"), image.astype(np.float32))


@pytest.mark.parametrize("kind", ["NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB"])
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_exr_of_every_compression_is_read(tmp_path: Path, kind: str, dtype: type) -> None:
    ramp = np.linspace(0.1, 1, 40 * 33, dtype=dtype).reshape(40, 33)
    header = {"compression": getattr(OpenEXR, f"{kind}_COMPRESSION"), "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGBA": np.stack([ramp, 2 * ramp, 3 * ramp, ramp], -1)}) as file:
        file.write(str(tmp_path / "a.exr"))
    image = read_exr(tmp_path / "a.exr")
    np.testing.assert_allclose(image, np.stack([ramp, 2 * ramp, 3 * ramp, ramp], -1), rtol=0.02)
    assert image_header(tmp_path / "a.exr", (tmp_path / "a.exr").read_bytes()).size == (40, 33)


def test_hdr_rounds_to_eight_bits_of_the_largest_channel_once(tmp_path: Path) -> None:
    """Cut, as OpenCV does, the error was -0.16 % in the mean and 0.77 % at most, at each writing."""
    image = np.exp(np.random.default_rng(1).normal(0, 4, (16, 32, 3)))
    image[0, 0], image[0, 1] = (0.999, 0.5, 0.3), 0  # the largest needs the next exponent; black
    write_hdr(tmp_path / "a.hdr", image)
    found = read_hdr(tmp_path / "a.hdr")
    error = (found - image) / np.maximum(image.max(-1, keepdims=True), 1e-9)
    assert np.abs(error).max() < 1 / 255
    assert abs(error.mean()) < 2e-4
    write_hdr(tmp_path / "b.hdr", found)
    assert (tmp_path / "b.hdr").read_bytes() == (tmp_path / "a.hdr").read_bytes()


def test_hdr_with_a_long_header_is_read(tmp_path: Path) -> None:
    write_hdr(tmp_path / "a.hdr", np.ones((16, 32, 3)))
    pixels = (tmp_path / "a.hdr").read_bytes().split(b"\n\n", 1)[1]
    header = b"#?RGBE\n# a comment\nEXPOSURE=1.0\nSOFTWARE=some tool 4.1\nFORMAT=32-bit_rle_rgbe\nPRIMARIES=0 0\n\n"
    (tmp_path / "b.hdr").write_bytes(header + pixels)
    np.testing.assert_array_equal(read_hdr(tmp_path / "b.hdr"), np.ones((16, 32, 3)))


@pytest.fixture(params=["a.png", "a.exr", "a.hdr"])
def file(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / request.param
    image = RANDOM.random((40, 33, 3))
    {".png": write_png, ".exr": write_exr, ".hdr": write_hdr}[path.suffix](path, image)
    return path


def test_a_file_cut_anywhere_is_an_error(file: Path, capfd: pytest.CaptureFixture[str]) -> None:
    data = file.read_bytes()
    for length in {0, 1, 7, 8, 30, *range(31, len(data), 97), len(data) - 1}:
        file.write_bytes(data[:length])
        with pytest.raises(DataError, match=file.name):
            read_image(file)
    assert capfd.readouterr().err == ""


def test_missing_files_and_folders_are_errors(file: Path) -> None:
    for path in (file.with_name("none" + file.suffix), file / ("below" + file.suffix)):
        with pytest.raises(DataError, match="cannot read"):
            read_image(path)


def test_a_file_that_is_something_else_is_an_error(file: Path) -> None:
    file.write_bytes(b"<html>404</html>" * 20)
    with pytest.raises(DataError, match="does not begin like"):
        read_image(file)


@settings(max_examples=60, deadline=None)
@given(place=st.integers(0, 10_000), value=st.integers(1, 255))
def test_a_png_with_any_byte_altered_is_an_error(
    tmp_path_factory: pytest.TempPathFactory, place: int, value: int
) -> None:
    file = tmp_path_factory.getbasetemp() / "altered.png"
    write_png(file, np.random.default_rng(1).random((8, 8, 4)))
    data = bytearray(file.read_bytes())
    data[place % len(data)] ^= value
    file.write_bytes(data)
    with pytest.raises(DataError, match="damaged"):
        read_image(file)


@pytest.mark.parametrize(("width", "height"), [(60_000, 60_000), (0, 4), (1 << 31, 1), (16_000, 16_000)])
def test_a_header_that_claims_absurd_sizes_is_an_error(tmp_path: Path, width: int, height: int) -> None:
    (tmp_path / "a.png").write_bytes(png(width, height, b"abc"))
    (tmp_path / "a.hdr").write_bytes(
        b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n" + f"-Y {height} +X {width}\n".encode() + b"abc"
    )
    write_exr(tmp_path / "a.exr", np.ones((4, 4, 1)))
    data = (tmp_path / "a.exr").read_bytes()
    small = struct.pack("<4i", 0, 0, 3, 3)
    huge = struct.pack("<4i", 0, 0, min(width, 1 << 30) - 1, height - 1)
    (tmp_path / "a.exr").write_bytes(data.replace(small, huge))
    for name in ("a.png", "a.hdr", "a.exr"):
        with pytest.raises(DataError, match=r"damaged|RADIOGS_BENCH_LARGEST_IMAGE"):
            read_image(tmp_path / name)


def test_pixels_that_end_early_or_late_are_errors(tmp_path: Path) -> None:
    line = b"\0" + bytes(16)
    for lines in (3, 5):
        (tmp_path / "a.png").write_bytes(png(4, 4, line * lines))
        with pytest.raises(DataError, match="bytes of pixels"):
            read_image(tmp_path / "a.png")


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_errors_when_written_and_when_read(tmp_path: Path, value: float) -> None:
    image = np.ones((4, 4, 3), np.float16)
    image[1, 2, 0] = value
    for write, name in ((write_png, "a.png"), (write_exr, "a.exr"), (write_hdr, "a.hdr")):
        with pytest.raises(DataError, match=name):
            write(tmp_path / name, image)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": image}) as file:
        file.write(str(tmp_path / "a.exr"))
    with pytest.raises(DataError, match="NaN or infinite"):
        read_exr(tmp_path / "a.exr")


def test_an_unwritable_place_is_an_error(tmp_path: Path) -> None:
    for write, name in ((write_png, "a.png"), (write_exr, "a.exr"), (write_hdr, "a.hdr")):
        with pytest.raises(DataError, match="cannot write"):
            write(tmp_path / "none" / name, np.ones((2, 2, 3)))


def test_opencv_still_logs_afterwards(file: Path) -> None:
    level = LOGGING.getLogLevel()
    read_image(file)
    assert LOGGING.getLogLevel() == level


def test_real_light_maps_are_read(shared_data: Path) -> None:
    """Poly Haven's repeat the magic line of their header; Blender's are DWAB with tiny negative values."""
    files = sorted(path for end in ("hdr", "exr") for path in (shared_data / "envmaps").rglob(f"*.{end}"))
    assert len(files) >= 14
    for path in files:
        image = read_image(path)
        assert image.shape[1] == 2 * image.shape[0], path
        assert image.shape[2] in (3, 4)
        assert float(image.max()) > 1


def test_an_exr_with_subsampled_channels_is_called_that(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    header = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {name: np.ones((4, 4), np.float32) for name in "RGB"}) as file:
        file.write(str(path))
    whole = path.read_bytes()
    name, sampling = b"B\x00\x02\x00\x00\x00\x00\x00\x00\x00", b"\x01\x00\x00\x00"
    assert whole.count(name + sampling) == 1
    path.write_bytes(whole.replace(name + sampling, name + b"\x02\x00\x00\x00"))
    with pytest.raises(DataError, match=r"several sizes: B subsampled"):
        read_exr(path)
