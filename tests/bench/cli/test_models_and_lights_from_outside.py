"""Models and lights that cannot be what they are taken for end in an explanation, never in a black image or a crash."""

import json
import math
import shutil
from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
import torch
from PIL import Image, ImageSequence

import radiogs_bench as rb
from captured import TURNS, write_capture
from radiogs_bench.cli.main import main
from radiogs_bench.initial_viewpoint import upwards
from radiogs_bench.runs.trained_folder import product_of, read_about
from radiogs_bench.store.folder import Store, product_name
from radiogs_bench.store.seal import sealed, strict_json
from radiogs_core.errors import DataError
from radiogs_core.scene.light import EnvironmentMap, texel_directions
from radiogs_core.scene.placed_light import placed_light
from radiogs_core.surfels.stored_tensors import restored_surfels
from radiogs_datasets import load_scene
from radiogs_datasets.image_files import read_exr, read_image, write_exr, write_hdr
from radiogs_datasets.lights import read_light

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("outside") / "model"
    assert main(["train", "convex", "--preset", "smoke", "--no-score", "--out", str(out)]) == 0
    assert not (out / "score.json").exists()
    return out


@pytest.fixture
def model(trained: Path, tmp_path: Path) -> Path:
    """A copy that a test may damage."""
    return Path(shutil.copytree(trained, tmp_path / "model"))


def changed(model: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """Write the stored product anew, as another program could."""
    key = read_about(model)["training_key"]
    store, name = Store(model), product_name(key)
    stored = store.tensors(name, CPU)
    assert stored is not None
    change(stored["product"])
    store.put_tensors(name, stored)


def set_nan(name: str) -> Callable[[dict[str, Any]], None]:
    def change(product: dict[str, Any]) -> None:
        product["surfels"][name][3] = math.nan

    return change


def put(name: str, value: object) -> Callable[[dict[str, Any]], None]:
    return lambda product: product.update({name: value})


def put_surfels(name: str, value: object) -> Callable[[dict[str, Any]], None]:
    return lambda product: product["surfels"].update({name: value})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "what"),
    [
        (set_nan("centre"), "'centre' of the stored model holds 3 values"),
        (set_nan("opacity_logit"), "'opacity_logit' of the stored model holds 1 values"),
        (put("log_environment", torch.zeros(0, 0, 3)), "'log_environment' of the stored model has the shape (0, 0, 3)"),
        (put("log_environment", torch.zeros(8, 16)), "'log_environment' of the stored model has the shape (8, 16)"),
        (put("log_environment", torch.full((8, 16, 3), math.inf)), "'log_environment' of the stored model holds 384"),
        (
            put("log_environment", [1.0]),
            "'log_environment' of the stored model is missing, or is not a floating-point tensor",
        ),
        (put_surfels("rotation", torch.zeros(5, 4)), "'rotation' of the stored model has the shape (5, 4)"),
        (put_surfels("sh", torch.zeros(5, 16, 3)), "'sh' of the stored model has the shape (5, 16, 3)"),
        (put_surfels("albedo_logit", torch.tensor(1.0)), "'albedo_logit' of the stored model has the shape ()"),
        (put_surfels("metallic", torch.zeros(5)), "'metallic' of the stored model is not a parameter"),
    ],
)
def test_a_model_that_is_misshapen_or_not_finite_is_not_rendered(
    model: Path, capsys: pytest.CaptureFixture[str], change: Callable[[dict[str, Any]], None], what: str
) -> None:
    """Audit M13: NaN centres rendered black, exit 0. M19: a light of [0, 0, 3] crashed, [8, 16] was read beyond."""
    changed(model, change)
    assert main(["render", str(model)]) == 3
    assert what in capsys.readouterr().err
    assert not (model / "render").exists()


def test_surfels_of_lower_degrees_are_restored(model: Path) -> None:
    """Audit M19: the shapes that models have are let through."""
    product = product_of(model, read_about(model)["training_key"], CPU)
    stored: Mapping[str, Any] = product["surfels"]
    for coefficients in (1, 4, 9, 16):
        few = restored_surfels({**stored, "sh": stored["sh"][:, :coefficients]})
        assert few.sh.shape[1] == coefficients
    with pytest.raises(DataError, match="'sh'"):
        restored_surfels({**stored, "sh": stored["sh"][:, :5]})
    with pytest.raises(DataError, match="'surfels'"):
        restored_surfels([1])


@pytest.mark.parametrize("shading", ["ray-marching", 3, None])
def test_a_model_with_an_unknown_value_of_its_variant_is_not_rendered(model: Path, shading: object) -> None:
    """Audit M13: an unknown shading in trained.json was rendered as if it were another."""
    about = json.loads((model / "trained.json").read_text())
    about["variant"]["shading"] = shading
    del about["seal"]
    (model / "trained.json").write_bytes(strict_json(sealed(about)))
    assert main(["render", str(model)]) == 2


@pytest.mark.parametrize("shape", [(0, 0, 3), (8, 16), (8, 16, 4), (8, 0, 3)])
def test_a_map_of_light_has_texels_of_three_channels(shape: tuple[int, ...]) -> None:
    """Audit M19: shapes of lights were never looked at."""
    with pytest.raises((DataError, TypeError)):
        EnvironmentMap(torch.zeros(shape))


def exr(path: Path, channels: Mapping[str, np.ndarray]) -> Path:
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, dict(channels)) as file:
        file.write(str(path))
    return path


def test_a_light_without_light_or_without_colour_is_refused(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Audit M15: a negative light gave black images, unsaid. M27: one or two channels ended in a traceback."""
    plain = np.full((4, 8), -1, np.float32)
    dark = exr(tmp_path / "dark.exr", dict.fromkeys("RGB", plain))
    grey = exr(tmp_path / "grey.exr", {"Y": -plain})
    two = exr(tmp_path / "two.exr", {"R": -plain, "G": -plain})
    for light, what in ((dark, "none of its radiance is above zero"), (grey, "1 channels"), (two, "channels G, R")):
        assert main(["relight", str(trained), "--envmap", str(light)]) == 3
        assert what in capsys.readouterr().err


def test_negative_values_of_a_light_are_set_to_zero_and_reported(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Audit M15: what cannot be radiance does not enter an image unsaid."""
    ramp = np.linspace(-0.1, 1, 32, dtype=np.float32).reshape(4, 8)
    light = exr(tmp_path / "ramp.exr", dict.fromkeys("RGB", ramp))
    radiance, said = read_light(light)
    assert float(radiance.radiance.min()) == 0
    assert main(["relight", str(trained), "--envmap", str(light)]) == 0
    assert said[0] in capsys.readouterr().out
    assert "9 negative values" in said[0]


def test_a_light_as_bright_as_the_sun_is_rendered_and_written(trained: Path, tmp_path: Path) -> None:
    """Audit M34: PNG was written, then 'half floats end at 65504' ended the command."""
    radiance = np.full((8, 16, 3), 0.1, np.float32)
    radiance[1, 3:5] = 1e7
    write_hdr(tmp_path / "sun.hdr", radiance)
    assert main(["relight", str(trained), "--envmap", str(tmp_path / "sun.hdr")]) == 0
    folder = trained / "relight/bounces"
    bright = [read_exr(path) for path in sorted(folder.glob("*/sun/*.exr"))]
    assert max(float(image.max()) for image in bright) > 65504


@pytest.mark.parametrize("scale", ["nan,1,1", "1,inf,1", "0,1,1", "1,1", "1,1,x"])
def test_factors_of_albedo_are_finite_and_above_zero(
    trained: Path, capsys: pytest.CaptureFixture[str], scale: str
) -> None:
    """Audit M35: nan passed, and a file was blamed."""
    assert main(["relight", str(trained), "--envmap", "x.hdr", "--albedo-scale", scale]) == 2
    assert "albedo-scale" in capsys.readouterr().err


def test_two_lights_of_one_name_do_not_share_a_folder(trained: Path, tmp_path: Path) -> None:
    """Audit M39: x.hdr and x.exr wrote over one another."""
    bright, dim = np.full((4, 8, 3), 1.0, np.float32), np.full((4, 8, 3), 0.1, np.float32)
    write_hdr(tmp_path / "x.hdr", bright)
    write_exr(tmp_path / "x.exr", dim)
    for name in ("x.hdr", "x.exr"):
        assert main(["relight", str(trained), "--envmap", str(tmp_path / name)]) == 0
    relit = trained / "relight/bounces/relit"
    assert (relit / "x/test_000.png").read_bytes() != (relit / "x_exr/test_000.png").read_bytes()


@pytest.mark.parametrize("name", ["...hdr", "..exr", "a\nb.hdr", "y" * 240 + ".hdr"])
def test_a_light_without_a_name_of_its_own_is_refused(trained: Path, tmp_path: Path, name: str) -> None:
    """Audit M39: renders under the stem '..' lay outside the folder. M28: names too long failed after rendering."""
    write = write_hdr if name.endswith(".hdr") else write_exr
    write(tmp_path / name, np.ones((4, 8, 3), np.float32))
    before = sorted(trained.parent.rglob("*"))
    assert main(["relight", str(trained), "--envmap", str(tmp_path / name)]) in (2, 3)
    assert sorted(trained.parent.rglob("*")) == before


def test_probe_looks_for_its_folder_before_it_works(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Audit M27: a missing folder for the picture was found after all the work."""
    assert main(["probe", "no-such-scene", "--picture", str(tmp_path / "none/a.png")]) == 2
    assert "there is no folder" in capsys.readouterr().err


def sun(height: int = 16) -> np.ndarray:
    """A sky whose light comes from +X, 30 degrees high."""
    radiance = np.full((height, 2 * height, 3), 0.2, np.float32)
    radiance[height // 3, height - 1 : height + 1] = (40, 35, 30)
    return radiance


def relit(trained: Path, folder: str) -> np.ndarray:
    return np.stack([read_image(path) for path in sorted((trained / "relight/bounces/relit" / folder).glob("*.png"))])


@pytest.mark.slow
def test_a_light_is_turned_and_scaled_and_its_orientation_printed(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_hdr(tmp_path / "sun.hdr", sun())
    write_hdr(tmp_path / "east.hdr", 2 * np.roll(sun(), -8, 1))  # by a quarter, towards +Y, twice as strong
    command = ["relight", str(trained), "--envmap"]
    assert main([*command, str(tmp_path / "sun.hdr")]) == 0
    said = capsys.readouterr().out
    assert "sun.hdr: the map's top is +Z of the scene's world, its centre column +X" in said
    assert main([*command, str(tmp_path / "sun.hdr"), "--turn", "90", "--strength", "2"]) == 0
    assert "its centre column +Y" in capsys.readouterr().out
    assert main([*command, str(tmp_path / "east.hdr")]) == 0
    assert main([*command, str(tmp_path / "sun.hdr"), "--up=-Z"]) == 0
    assert "top is -Z of the scene's world" in capsys.readouterr().out
    plain, turned = relit(trained, "sun"), relit(trained, "sun_turn90_strength2")
    assert float(np.abs(turned - relit(trained, "east")).mean()) < 0.01 < float(np.abs(plain - turned).mean())
    assert float(np.abs(plain - relit(trained, "sun_up0,0,-1")).mean()) > 0.01


def test_lamps_light_a_model_with_and_without_a_map_and_turn_with_it(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "two.toml").write_text("[[sun]]\nazimuth = 120\nelevation = 40\n[[point]]\nposition = [0, 0, 3]\n")
    assert main(["relight", str(trained), "--sun", "120,40", "--point=0,0,3", "--turntable", "2"]) == 0
    said = capsys.readouterr().out
    assert "suns: the zenith is +Z of the scene's world, azimuth 0 +X" in said
    assert "the model lies in x -" in said
    assert len(list(trained.rglob("sun120,40/relit.gif"))) == 0 < len(list(trained.rglob("*sun120,40/relit.gif")))
    options = ["--light", str(tmp_path / "two.toml"), "--turn", "90", "--strength", "2"]
    assert main(["relight", str(trained), *options]) == 0
    assert main(["relight", str(trained), *options, "--envmap", "sunset"]) == 0
    folder = trained / "relight/lamps"
    direct = [
        np.stack([read_exr(path) for path in sorted((folder / "direct" / name).glob("*.exr"))])
        for name in ("point0,0,3+sun120,40", "two_turn90_strength2", "sunset+two_turn90_strength2")
    ]
    assert direct[0].mean() > 0.01
    assert np.abs(direct[1] - 2 * direct[0]).mean() > 0.01, "the sun has turned"
    assert (direct[2] - direct[1]).min() > -1e-4
    assert (direct[2] - direct[1]).mean() > 0.01, "the map adds its light"


def test_shares_of_white_and_black_relit_pixels_are_printed(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_hdr(tmp_path / "grey.hdr", np.full((4, 8, 3), 0.7, np.float32))
    for strength, word in (("1000", "white"), ("0.0001", "black"), ("1", "")):
        command = ["relight", str(trained), "--envmap", str(tmp_path / "grey.hdr"), "--strength", strength]
        assert main(command) == 0
        said = capsys.readouterr().out
        assert ("% of the model's pixels in these views are" in said) == bool(word)
        assert f"are {word}" in said or not word


def test_a_relit_turntable_turns_and_follows_the_light(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mean = {}
    for name, level in (("dim", 0.2), ("bright", 0.8)):
        write_hdr(tmp_path / f"{name}.hdr", np.full((4, 8, 3), level, np.float32))
        assert main(["relight", str(trained), "--envmap", str(tmp_path / f"{name}.hdr"), "--turntable", "4"]) == 0
        path = next(trained.rglob(f"{name}/relit.gif"))
        assert f"turntable: {path}" in capsys.readouterr().out
        with Image.open(path) as gif:
            assert gif.n_frames == 4  # type: ignore[attr-defined]
            frames = [np.asarray(frame.convert("RGB"), float) for frame in ImageSequence.Iterator(gif)]
        assert all(np.abs(one - other).mean() > 1 for one, other in pairwise(frames))
        mean[name] = float(np.mean(frames))
    assert mean["bright"] > 1.5 * mean["dim"] > 0


@pytest.mark.parametrize(
    "wrong", [["--up", "W"], ["--up", "0,0,0"], ["--up", "1,2"], ["--turn", "nan"], ["--strength", "0"]]
)
def test_a_direction_a_turn_and_a_strength_are_looked_at(
    trained: Path, capsys: pytest.CaptureFixture[str], wrong: list[str]
) -> None:
    assert main(["relight", str(trained), "--envmap", "x.hdr", *wrong]) == 2
    assert wrong[0] in capsys.readouterr().err


def test_a_cube_map_relights_correctly_and_other_shapes_are_refused(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """OpenEXR's cube maps, and squares, were taken for latitude-longitude without a word."""
    cube = np.full((384, 64, 3), 0.2, np.float32)
    cube[128:192] = (3, 2, 1)  # its third face is the top
    flat = np.full((128, 256, 3), 0.2, np.float32)
    rise = texel_directions(128, 256).numpy()
    flat[rise[..., 2] >= np.abs(rise[..., :2]).max(-1)] = (3, 2, 1)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "envmap": OpenEXR.ENVMAP_CUBE}
    channels = {name: np.ascontiguousarray(cube[..., place]) for place, name in enumerate("RGB")}
    with OpenEXR.File(header, channels) as file:
        file.write(str(tmp_path / "cube.exr"))
    write_exr(tmp_path / "flat.exr", flat)
    for name in ("cube", "flat"):
        assert main(["relight", str(trained), "--envmap", str(tmp_path / f"{name}.exr")]) == 0
    assert "cube.exr: converted from a cube map" in capsys.readouterr().out
    assert float(np.abs(relit(trained, "cube") - relit(trained, "flat")).mean()) < 0.01
    write_hdr(tmp_path / "square.hdr", np.random.default_rng(0).random((8, 8, 3)) + 0.1)
    before = sorted(trained.rglob("*"))
    assert main(["relight", str(trained), "--envmap", str(tmp_path / "square.hdr")]) == 3
    assert "8 x 8 pixels: no latitude-longitude map" in capsys.readouterr().err
    assert sorted(trained.rglob("*")) == before
    with pytest.raises(DataError, match="the light is 8 x 8 pixels"):
        rb.open_model(trained).prepared(EnvironmentMap(torch.rand(8, 8, 3)))


@pytest.mark.slow
@pytest.mark.parametrize("world", ["Y down", "Y up", "X up", "tilted"])
def test_one_light_has_the_same_orientation_in_every_world_of_a_capture(tmp_path: Path, world: str) -> None:
    """The sky's top was taken for +Z of the capture's world; COLMAP's worlds have Y down, or any direction."""
    shown = {}
    light = EnvironmentMap(torch.rand(16, 32, 3, generator=torch.Generator().manual_seed(0)))
    for name in ("Z up", world):
        scene = load_scene(str(write_capture(tmp_path / name, every=4, world=name)))
        up = upwards(scene)
        assert up.tolist() == pytest.approx(TURNS[name][:, 2].tolist(), abs=1e-5)
        shown[name] = placed_light(light, up)[0]
    directions = torch.nn.functional.normalize(torch.randn(500, 3), dim=-1)
    there = directions @ torch.tensor(TURNS[world].T, dtype=torch.float32)
    assert float((shown["Z up"].lookup(directions) - shown[world].lookup(there)).abs().mean()) < 0.05


@pytest.mark.slow
def test_relit_views_of_one_capture_in_two_worlds_agree(tmp_path: Path) -> None:
    """They were 18 to 19 dB apart; two smoke models of one world differ by 24 dB."""
    write_hdr(tmp_path / "sun.hdr", sun())
    found = {}
    for name in ("Z up", "Y down"):
        capture, out = write_capture(tmp_path / name, every=1, world=name), tmp_path / f"out {name}"
        masks = ["--mask-folder", str(capture / "masks")]
        assert main(["train", str(capture), *masks, "--preset", "smoke", "--no-score", "--out", str(out)]) == 0
        assert main(["relight", str(out), "--envmap", str(tmp_path / "sun.hdr")]) == 0
        found[name] = relit(out, "sun")
    error = float(np.square(found["Z up"] - found["Y down"]).mean())
    assert -10 * math.log10(error) > 22
