"""``score`` names the reading in which images fit their truth far better, and does not comment on bad images."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch.nn.functional import adaptive_avg_pool2d, avg_pool2d, interpolate, normalize, pad

from radiogs_baselines.outputs.reading import read_predictions
from radiogs_bench.cli import main
from radiogs_bench.scoring.other_readings import other_readings
from radiogs_bench.scoring.score_maps import coverage, truth
from radiogs_core.scene.colour import srgb_decode, srgb_encode
from radiogs_core.scene.scene import Scene
from radiogs_datasets import load_scene
from radiogs_datasets.image_files import write_exr, write_png

Change = Callable[[torch.Tensor], torch.Tensor]


@pytest.fixture(scope="module")
def scene() -> Scene:
    return few("corner")


def write(folder: Path, scene: Scene, name: str, change: Change, order: list[int] | None = None) -> Path:
    """A map of every test view in the layout ``plain``, changed on black; relit under the first light alone."""
    light = name.removeprefix("relit/")
    for place, view in enumerate(scene.test):
        shown = scene.test[order[place]] if order else view
        image = change(truth(shown, name)).numpy()
        if name == "normal":
            path = folder / "normal" / f"{view.name}.exr"
            path.parent.mkdir(parents=True, exist_ok=True)
            write_exr(path, image)
        else:
            path = folder / (f"relit/{light}" if light != name else name) / f"{view.name}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            write_png(path, image)
    return folder


def said(folder: Path, scene: Scene) -> list[str]:
    return other_readings(read_predictions(folder, scene, "plain"), scene)


def blurred(image: torch.Tensor, radius: int) -> torch.Tensor:
    channels = pad(image.permute(2, 0, 1)[None], [radius] * 4, mode="replicate")
    return avg_pool2d(channels, 2 * radius + 1, 1)[0].permute(1, 2, 0)


def coarse(image: torch.Tensor, side: int) -> torch.Tensor:
    means = adaptive_avg_pool2d(image.permute(2, 0, 1)[None], side)
    return interpolate(means, size=image.shape[:2])[0].permute(1, 2, 0)


def noisy(image: torch.Tensor, sigma: float) -> torch.Tensor:
    return (image + sigma * torch.randn(image.shape, generator=torch.Generator().manual_seed(0))).clamp(0, 1)


BAD: dict[str, Change] = {
    "exact": lambda image: image,
    "noise": lambda image: noisy(image, 0.05),
    "much noise": lambda image: noisy(image, 0.3),
    "blurred": lambda image: blurred(image, 2),
    "much blurred": lambda image: blurred(image, 10),
    "coarse": lambda image: coarse(image, 4),
    "one colour": lambda image: coarse(image, 1),
    "black": torch.zeros_like,
    "grey": lambda image: image.mean(-1, keepdim=True).expand(-1, -1, 3),
    "dim and noisy": lambda image: noisy(0.7 * image, 0.1),
    "fog": lambda image: 0.8 * image + 0.03,
    "tinted": lambda image: image * torch.tensor([1.0, 0.8, 0.6]),
    "out of register": lambda image: image.roll(3, 1),
}


def few(name: str) -> Scene:
    """A miniature with half of its test views."""
    whole = load_scene(name)
    return replace(whole, test=whole.test[:4])


def test_right_and_merely_bad_images_cause_no_remark(tmp_path: Path, scene: Scene) -> None:
    for what in ("exact", "much noise", "much blurred", "coarse", "black"):
        assert said(write(tmp_path / what, scene, "image", BAD[what]), scene) == [], what


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mirror", "front_plain"])
@pytest.mark.parametrize("kind", ["image", "albedo"])
def test_images_that_are_merely_bad_cause_no_remark(tmp_path: Path, name: str, kind: str) -> None:
    scene = few(name)
    for what, change in BAD.items():
        assert said(write(tmp_path / what, scene, kind, change), scene) == [], what


def test_right_and_merely_bad_normals_cause_no_remark(tmp_path: Path, scene: Scene) -> None:
    for what in ("exact", "much noise", "much blurred", "coarse"):
        change = BAD[what]
        folder = write(tmp_path / what, scene, "normal", lambda n, c=change: normalize(2 * c(n / 2 + 0.5) - 1, dim=-1))
        assert said(folder, scene) == [], what


READINGS: list[tuple[str, Change, str]] = [
    ("image", lambda image: image.flip(-1), "red and blue exchanged"),
    ("image", lambda image: image.flip(0), "upside down"),
    ("image", lambda image: image.flip(1), "mirrored left to right"),
    ("image", lambda image: image.flip(0, 1), "turned by half a turn"),
    ("image", srgb_decode, "taken for linear values and converted to sRGB"),
    ("image", srgb_encode, "one sRGB curve taken away"),
    ("image", lambda image: srgb_encode(0.4 * srgb_decode(image)), "times 2.5 in linear light"),
    ("image", lambda image: image**1.6, "to the power 0.6"),
    ("albedo", srgb_encode, "taken for sRGB values and converted to linear ones"),
    ("albedo", lambda image: 0.7 * srgb_encode(image), "taken for sRGB values"),
    ("albedo", lambda image: image.flip(0), "upside down"),
    ("relit/sunset", srgb_decode, "images relit under sunset: taken for linear values"),
    ("normal", lambda n: n[..., [0, 2, 1]] * torch.tensor([1.0, 1, -1]), "(x, -z, y) of the file for x, y and z"),
    ("normal", lambda n: -n, "(-x, -y, -z) of the file for x, y and z of the world"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "change", "sentence"), READINGS)
def test_the_reading_that_fits_far_better_is_named(
    tmp_path: Path, scene: Scene, name: str, change: Change, sentence: str
) -> None:
    fitted = "times" in sentence or "power" in sentence  # a number that is fitted needs more evidence

    def written(image: torch.Tensor) -> torch.Tensor:
        return change(image if name == "normal" or fitted else noisy(image, 0.03))

    found = said(write(tmp_path, scene, name, written), scene)
    assert len(found) == 1
    assert sentence in found[0]


@pytest.mark.parametrize(
    ("flip", "sentence"), [((1.0, 1.0, 1.0), "(x, y, z) of the file"), ((1.0, -1.0, -1.0), "(x, -y, -z) of the file")]
)
def test_normals_in_the_cameras_axes_are_named(
    tmp_path: Path, scene: Scene, flip: tuple[float, ...], sentence: str
) -> None:
    """OpenCV's and OpenGL's axes of a camera."""
    (tmp_path / "normal").mkdir()
    for view in scene.test:
        seen = (view.read("normal") @ view.camera.axes.float()) * torch.tensor(flip)
        write_exr(tmp_path / "normal" / f"{view.name}.exr", seen.numpy())
    (found,) = said(tmp_path, scene)
    assert f"{sentence} for right, down and forward of each camera" in found


@pytest.mark.parametrize("colour", [(1.0, 1.0, 1.0), (0.1, 0.6, 0.2)])
def test_a_ground_is_named(tmp_path: Path, scene: Scene, colour: tuple[float, ...]) -> None:
    folder = tmp_path / "image"
    folder.mkdir()
    for view in scene.test:
        mask = coverage(view)
        image = noisy(truth(view, "image"), 0.1) * mask + (1 - mask) * torch.tensor(colour)
        write_png(folder / f"{view.name}.png", image.numpy())
    (found,) = said(tmp_path, scene)
    assert ("--ground white" in found) == (colour[0] == 1)
    assert ("write them on black" in found) == (colour[0] != 1)


@pytest.mark.slow
def test_images_on_white_score_as_on_black_with_the_option(
    tmp_path: Path, scene: Scene, capsys: pytest.CaptureFixture[str]
) -> None:
    """The perfect image on white silently scored 3 dB. With an alpha channel the ground does not matter."""
    for view in load_scene("corner").test:
        image, mask = truth(view, "image"), coverage(view)
        for folder, stored in (("white", image + 1 - mask), ("straight", torch.cat([view.read("image"), mask], -1))):
            (tmp_path / folder).mkdir(exist_ok=True)
            write_png(tmp_path / folder / f"{view.name}.png", stored.numpy())
    found = {}
    for folder, ground in (("white", None), ("white", "white"), ("straight", None), ("straight", "white")):
        command = ["score", str(tmp_path / folder), "--scene", "corner", "--json"]
        assert main(command + (["--ground", ground] if ground else [])) == 0
        record = json.loads(capsys.readouterr().out)
        found[folder, ground] = record["protocols"]["default"]["metrics"]["nvs/psnr"]["value"], record["remarks"]
    assert found["white", None][0] < 10
    assert any("--ground white" in remark for remark in found["white", None][1])
    for key in (("white", "white"), ("straight", None), ("straight", "white")):
        assert found[key][0] > 50
        assert not any("better" in remark for remark in found[key][1])


@pytest.mark.parametrize("white", [False, True])
def test_views_in_another_order_are_named(tmp_path: Path, white: bool) -> None:
    scene = load_scene("corner")

    def write_in(order: list[int]) -> list[str]:
        for place, view in enumerate(scene.test):
            shown = scene.test[order[place]]
            image = noisy(truth(shown, "image"), 0.1) + (1 - coverage(shown)) * white
            write_png(tmp_path / f"{view.name}.png", image.numpy())
        return [each for each in said(tmp_path, scene) if "ground" not in each]

    (found,) = write_in([3, 1, 2, 0, 4, 5, 6, 7])
    assert "views test_000 and test_003 fit each other's truth better" in found
    (found,) = write_in([1, 2, 3, 4, 5, 6, 7, 0])
    assert "8 views fit the truth of other views better" in found
    assert "test_000 that of test_001" in found
    assert write_in(list(range(8))) == []


def test_the_option_goes_with_images_of_a_scene_alone(tmp_path: Path) -> None:
    (tmp_path / "trained.json").write_text("{}")
    assert main(["score", str(tmp_path), "--ground", "white"]) == 2
