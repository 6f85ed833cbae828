"""A scene written in another layout is the same scene, as far as the layout can carry it."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.scene import Scene, View
from radiogs_datasets import load_scene
from radiogs_datasets.reduction import smaller
from radiogs_datasets.writing import convert
from scenes import sphere_scene

HALF_LEVEL = 0.5 / 255 + 1e-6
"""Largest change of a stored value by rounding to 8 bits."""


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene("corner")


@pytest.fixture(scope="module")
def written(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Scene, tuple[str, ...]]]:
    found = {}
    for layout in ("tensoir", "synthetic4relight", "blender"):
        folder = tmp_path_factory.mktemp("converted") / layout
        lost = convert(scene, folder, layout)
        found[layout] = (load_scene(str(folder)), lost)
    return found


@pytest.mark.parametrize("layout", ["tensoir", "synthetic4relight", "blender"])
def test_the_layout_is_recognised_and_holds_the_same_views(
    layout: str, scene: Scene, written: dict[str, tuple[Scene, tuple[str, ...]]]
) -> None:
    again, _ = written[layout]
    assert again.layout == layout
    assert (len(again.train), len(again.test)) == (len(scene.train), len(scene.test))
    for ours, theirs in zip((*again.train, *again.test), (*scene.train, *scene.test), strict=True):
        torch.testing.assert_close(ours.camera.camera_to_world, theirs.camera.camera_to_world, rtol=0, atol=1e-6)
        assert ours.camera.fx == pytest.approx(theirs.camera.fx, rel=1e-6)


@pytest.mark.parametrize("layout", ["tensoir", "synthetic4relight", "blender"])
def test_maps_are_the_same_to_the_files_precision(
    layout: str, scene: Scene, written: dict[str, tuple[Scene, tuple[str, ...]]]
) -> None:
    again, _ = written[layout]
    for ours, theirs in zip(again.test, scene.test, strict=True):
        alpha = theirs.read("alpha")
        torch.testing.assert_close(ours.read("alpha"), alpha, rtol=0, atol=HALF_LEVEL)
        solid = alpha[..., 0] == 1
        for name in ours.sources.keys() - {"alpha", "albedo", "normal"}:
            radiance = name in ("depth", "direct", "indirect") or name.endswith("/indirect")
            rtol, atol = (1e-3, 1e-6) if radiance else (0, HALF_LEVEL)
            torch.testing.assert_close(ours.read(name)[solid], theirs.read(name)[solid], rtol=rtol, atol=atol, msg=name)
        if ours.has("albedo"):
            # Linear albedo through 8-bit sRGB: half a level times the curve's slope, at most 1 / 0.44 at white.
            error = (ours.read("albedo") - theirs.read("albedo"))[solid].abs().max()
            assert float(error) < 2.3 * HALF_LEVEL
        if ours.has("normal"):
            cosine = (ours.read("normal") * theirs.read("normal")).sum(-1)[solid]
            assert float(cosine.min()) > 1 - 1e-4


@pytest.mark.parametrize("layout", ["tensoir", "synthetic4relight"])
def test_lights_come_back_in_the_same_orientation(
    layout: str, scene: Scene, written: dict[str, tuple[Scene, tuple[str, ...]]]
) -> None:
    again, _ = written[layout]
    assert again.lights.keys() == scene.lights.keys()
    for name, light in scene.lights.items():
        torch.testing.assert_close(again.lights[name].radiance, light.radiance, rtol=1e-2, atol=1e-2)
    torch.testing.assert_close(again.training_light.radiance, scene.training_light.radiance, rtol=1e-2, atol=1e-2)


def test_what_a_layout_cannot_store_is_listed(scene: Scene, written: dict[str, tuple[Scene, tuple[str, ...]]]) -> None:
    assert written["tensoir"][1] == ()
    lost = " ".join(written["synthetic4relight"][1])
    for name in ("normal", "depth", "direct", "indirect"):
        assert f"{name} of {len(scene.test)} test views" in lost
    lost = " ".join(written["blender"][1])
    assert "albedo of" in lost
    assert "light '" in lost


def test_nothing_is_overwritten_and_no_half_scene_stays(scene: Scene, tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "there/mine.txt").write_text("kept")
    with pytest.raises(UsageError, match="exists already"):
        convert(scene, tmp_path / "there", "blender")
    with pytest.raises(UsageError, match="unknown layout to write 'colmab'"):
        convert(scene, tmp_path / "new", "colmab")

    def stop(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        convert(scene, tmp_path / "new", "blender", stop)
    assert [path.name for path in tmp_path.iterdir()] == ["there"]


def test_photos_of_any_size_are_written_smaller_with_a_lens_each(tmp_path: Path) -> None:
    """1000 x 659 by 8: 125 x 82, and pixels that are no longer square."""
    camera = replace(sphere_scene().train[0].camera, fx=2000.0, fy=2010.0, cx=498.0, cy=331.0, width=1000, height=659)
    view = View("a", camera, {"image": lambda: torch.full((659, 1000, 3), 0.5)})
    other = replace(view, name="b", camera=replace(camera, fx=1900.0))
    scene = smaller(Scene("two", "colmap", (view, other), (view,), {}, None, "0" * 64), 8)
    convert(scene, tmp_path / "new", "blender")
    again = load_scene(str(tmp_path / "new"))
    for ours, theirs in zip((*again.train, *again.test), (*scene.train, *scene.test), strict=True):
        assert (ours.camera.width, ours.camera.height) == (125, 82)
        for name in ("fx", "fy", "cx", "cy"):
            assert getattr(ours.camera, name) == pytest.approx(getattr(theirs.camera, name), rel=1e-12)
        torch.testing.assert_close(ours.read("image"), theirs.read("image"), rtol=0, atol=HALF_LEVEL)


def test_cameras_that_one_angle_cannot_say_are_refused(scene: Scene, tmp_path: Path) -> None:
    view = scene.train[0]
    camera = view.camera
    off = Camera(camera.camera_to_world, camera.fx, camera.fy, camera.cx + 3, camera.cy, camera.width, camera.height)
    odd = replace(scene, train=(replace(view, camera=off), *scene.train[1:]))
    with pytest.raises(DataError, match="no place in this layout"):
        convert(odd, tmp_path / "new", "tensoir")
    assert not (tmp_path / "new").exists()
