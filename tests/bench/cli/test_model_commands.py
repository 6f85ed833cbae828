"""``train``, ``render`` and ``relight`` on a miniature: files, errors, and a second ``train`` that repeats nothing."""

import json
import re
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from plyfile import PlyData

from captured import write_capture
from radiogs.settings import Variant
from radiogs.showing import TrainedRadioGS
from radiogs_bench.cli.main import main
from radiogs_bench.runs.trained_folder import read_about, read_trained
from radiogs_bench.store.seal import seal_of
from radiogs_core.plain_values import flat, leaf_names
from radiogs_datasets import load_scene
from radiogs_datasets.image_files import read_exr, read_image, write_exr, write_hdr, write_png
from radiogs_datasets.registry import TINY
from surfel_files import read_ply

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("trained")
    assert main(["train", "convex", "--preset", "smoke", "--out", str(out)]) == 0
    return out


def test_the_model_is_written_in_full(folder: Path) -> None:
    run, trained = read_trained(folder, CPU)
    assert isinstance(trained, TrainedRadioGS)
    about, model = read_about(folder), trained.model
    assert about["scene"] == run.scene.name == "convex"
    assert about["facts"]["surfels"] == trained.facts()["surfels"] == len(model.surfels)
    for name, value in read_ply(folder / "surfels.ply").parameters().items():
        assert torch.equal(value, model.surfels.parameters()[name]), name
    # EXR files hold half floats: eleven bits.
    np.testing.assert_allclose(read_exr(folder / "environment.exr"), model.environment.numpy(), rtol=2**-11)


@pytest.mark.slow
def test_a_model_that_starts_from_splats_is_another_one_for_every_content_of_the_file(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its label says so, and ``settings.toml`` repeats it; a method without surfels and a file of none refuse."""
    first, other = tmp_path / "first.ply", tmp_path / "other.ply"
    first.write_bytes((folder / "surfels.ply").read_bytes())
    other.write_bytes(first.read_bytes() + b" ")
    command = ["train", "convex", "--preset", "smoke", "--no-score", "--out", str(tmp_path / "out")]
    assert main([*command, "--start", str(first)]) == 0
    assert "start: splats of a file with the SHA-256 " in capsys.readouterr().out
    key = read_about(tmp_path / "out")["training_key"]
    assert main([*command, "--config", str(tmp_path / "out/settings.toml")]) == 0
    assert main([*command, "--start", str(other)]) == 2, "it is another model"
    assert read_about(tmp_path / "out")["training_key"] == key != read_about(folder)["training_key"]
    (tmp_path / "mesh.ply").write_text("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0\n")
    elsewhere = [*command[:-1], str(tmp_path / "not")]
    assert main([*elsewhere, "--start", str(tmp_path / "mesh.ply")]) == 3
    assert main([*elsewhere, "--start", str(first), "--method", "tensoir"]) == 2
    assert "tensoir does not start from splats" in capsys.readouterr().err


def test_training_again_by_the_settings_that_were_written_repeats_nothing(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = {path: path.stat().st_mtime_ns for path in folder.rglob("*.pt")}
    settings, file = folder / "settings.toml", tmp_path / "mine.toml"
    command = ["train", "convex", "--preset", "smoke", "--out", str(folder), "--config"]
    assert main([*command, str(settings)]) == 0
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*.pt")} == kept
    said = capsys.readouterr().out
    names = "NVS PSNR ↑, NVS SSIM ↑, Albedo PSNR ↑, Normal MAE ↓, Roughness MSE ↓, Relight PSNR ↑"
    assert ", ".join(re.findall(r"^\| (.+?) \|", said, re.M)[2:]) == names
    assert re.search(r"^\| Normal MAE ↓ \| \d+\.\d\d \| deg \|$", said, re.M)
    text = settings.read_text()
    assert f"{text.count('# published: ')} settings are not as published: {settings} says which" in said
    assert len(said.splitlines()) < 25
    assert f"open {folder / 'contact_sheet.png'}: maps of view test_004" in said
    assert cv2.imread(str(folder / "contact_sheet.png")).shape[1] > 9 * 192, "truth, error, maps, one relit"
    table = tomllib.loads(text)
    assert leaf_names(Variant()) == [*flat(table["variant"])]
    file.write_text(text.replace("radiometric_weight = 0.2", "radiometric_weight = 0.3"))
    assert main([*command, str(file)]) == 2, "it is another model"
    assert main([*command, str(file), "--set", "radiometric_weight=0.2", "--no-score"]) == 0, "--set comes last"
    for wrong, code in (("[variant]\nweight = 1", 2), ("[variant", 2), (None, 3)):
        file.write_text(wrong) if wrong else file.unlink()
        assert main([*command, str(file)]) == code


def test_a_light_of_the_scene_and_the_picture_to_open_are_named(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    relit = folder / "relight" / "bounces" / "relit" / "sunset" / "test_000.png"
    shown = []
    for light in ("sunset", str(TINY / "convex" / "envmaps" / "sunset.hdr")):
        assert main(["relight", str(folder), "--envmap", light]) == 0
        assert f"such as {relit}; " in capsys.readouterr().out
        shown.append(relit.read_bytes())
    assert shown[0] == shown[1]
    assert main(["relight", str(folder), "--envmap", "sunst"]) == 2
    assert "unknown light 'sunst' of scene 'convex'\nDid you mean 'sunset'?" in capsys.readouterr().err


@pytest.mark.slow
def test_views_are_rendered_and_relit_in_every_mode(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_hdr(folder / "dim.hdr", np.full((8, 16, 3), 0.05, np.float32))
    assert main(["render", str(folder)]) == 0
    seen = read_image(folder / "render" / "image" / "test_000.png")
    assert read_exr(folder / "render" / "normal" / "test_000.exr").shape == (96, 96, 3)
    for mode in ("pbr", "bounces", "finetuned", "surfels", "path"):
        arguments = ["relight", str(folder), "--envmap", str(folder / "dim.hdr"), "--mode", mode]
        assert main(arguments) == 0
        relit = read_image(folder / "relight" / mode / "relit" / "dim" / "test_000.png")
        # Ten steps of fine-tuning dim the surfels only in part.
        assert relit.mean() < (1.0 if mode == "surfels" else 0.7) * seen.mean(), mode
    said = capsys.readouterr().out
    assert said.count("ms a frame") == 6
    assert "means little" not in said


def test_a_relighting_mode_that_the_method_does_not_offer_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_hdr(folder / "dim.hdr", np.full((8, 16, 3), 0.05, np.float32))
    arguments = ["relight", str(folder), "--envmap", str(folder / "dim.hdr")]
    assert main([*arguments, "--mode", "finetune"]) == 2
    said = capsys.readouterr().err
    assert "unknown relighting mode 'finetune' of radiogs" in said
    assert "Did you mean 'finetuned'?" in said
    assert "There are: pbr, bounces, finetuned, surfels, path." in said


def metrics_of(record: Path) -> dict[str, float | None]:
    (scores,) = json.loads(record.read_text())["protocols"].values()
    return {name: each["value"] for name, each in scores["metrics"].items()}


def test_training_ends_with_the_scores_of_the_model(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ended = metrics_of(folder / "score.json")
    assert {"nvs/psnr", "albedo/psnr", "relight/psnr", "normal/mae", "environment/error_scaled"} <= set(ended)
    assert main(["score", str(folder), "--out", str(folder / "again.json")]) == 0
    assert metrics_of(folder / "again.json") == ended
    assert f"{ended['nvs/psnr']:.4f}" in capsys.readouterr().out


@pytest.mark.slow
def test_rendered_and_relit_files_score_as_the_model_does(folder: Path, tmp_path: Path) -> None:
    """But for 8 bits of the images and 11 of the maps."""
    ended, light = metrics_of(folder / "score.json"), sorted(load_scene("convex").lights)[0]
    write_exr(tmp_path / f"{light}.exr", load_scene("convex").lights[light].radiance.numpy())
    assert main(["render", str(folder), "--relight"]) == 0
    assert main(["relight", str(folder), "--envmap", str(tmp_path / f"{light}.exr")]) == 0
    for place in ("render", "relight/bounces"):
        out = tmp_path / f"{Path(place).name}.json"
        assert main(["score", str(folder / place), "--scene", "convex", "--out", str(out)]) == 0
    rendered, relit = metrics_of(tmp_path / "render.json"), metrics_of(tmp_path / "bounces.json")
    maps = ("nvs/psnr", "albedo/psnr", "normal/mae", "roughness/mse", "environment/error_scaled", "depth/offset")
    for name in (*maps, "relight/psnr"):
        assert rendered[name] == pytest.approx(ended[name], rel=2e-3), name
    assert 5 < relit[f"relight/{light}/psnr"] < 50
    assert "nvs/psnr" not in relit


@pytest.mark.slow
def test_a_model_of_smaller_images_is_rendered_at_their_size(tmp_path: Path) -> None:
    """The scene's options are kept beside the model: `render` has no such option."""
    out = tmp_path / "small"
    arguments = ["train", "convex", "--preset", "smoke", "--out", str(out)]
    assert main([*arguments, "--long-side", "41"]) == 0
    assert read_about(out)["options"] == {"long_side": 41}
    assert main(["render", str(out)]) == 0
    assert read_image(out / "render" / "image" / "test_000.png").shape == (41, 41, 3)
    stages = len(list(out.glob("stages/*")))
    assert main([*arguments, "--reduce", "3", "--force"]) == 0, "another model is there"
    assert len(list(out.glob("stages/*"))) > stages
    assert read_trained(out, CPU)[0].scene.test[0].camera.width == 32


def test_a_model_opens_from_every_folder_and_after_its_scene_has_moved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`cd capture; train .` left a model of the scene '.', which every command looked for where it was called."""
    capture, out, root = write_capture(tmp_path / "here" / "capture", every=6), tmp_path / "model", tmp_path / "data"
    write_hdr(tmp_path / "dim.hdr", np.full((8, 16, 3), 0.05, np.float32))
    options = ["--preset", "smoke", "--long-side", "24", "--no-score", "--mask-folder"]
    monkeypatch.chdir(capture)
    assert main(["train", ".", *options, "masks"]) == 0
    (capture / "out" / "capture").rename(out)
    (capture / "out").rmdir()
    key, opened = read_about(out)["training_key"], ["--envmap", str(tmp_path / "dim.hdr")]
    monkeypatch.chdir(tmp_path)
    assert main(["render", str(out)]) == 0
    assert main(["relight", str(out), *opened]) == 0
    assert main(["view", str(out), "--frames", "1", "--size", "16"]) == 0
    assert main(["export", str(out), "--layout-of", "gs-ir"]) == 0
    assert main(["score", str(out)]) == 0
    monkeypatch.chdir(capture.parent)
    assert main(["train", "capture", *options, "capture/masks", "--out", str(out)]) == 0
    assert read_about(out)["training_key"] == key, "the path is no part of the key"
    root.mkdir()
    capture.rename(root / "capture")
    assert main(["render", str(out)]) == 3
    assert main(["render", str(out), "--data", str(root)]) == 0


def test_wrong_use_is_explained(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", str(tmp_path)]) == 3
    assert main(["relight", str(folder), "--envmap", "light.png"]) == 2
    assert main(["probe", str(folder), "--long-side", "40"]) == 2
    assert main(["train", "convex", "--reduce", "2", "--long-side", "40", "--out", str(tmp_path / "new")]) == 2
    assert main(["train", "convex", "--hold-out", "8", "--out", str(tmp_path / "new")]) == 2
    assert not (tmp_path / "new").exists()
    assert main(["relight", str(folder), "--envmap", str(tmp_path / "no.hdr")]) == 3
    assert main(["relight", str(folder), "--envmap", "x.hdr", "--albedo-scale", "1,2"]) == 2
    about = json.loads((folder / "trained.json").read_text())
    (tmp_path / "trained.json").write_text(json.dumps(about | {"checksum": "other"}))
    assert main(["render", str(tmp_path)]) == 3
    assert "nothing was trained" in capsys.readouterr().err


@pytest.mark.slow
def test_the_mesh_is_exported_with_its_distance_from_the_truth(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(folder), "--mesh", "--views", "test"]) == 0
    said = capsys.readouterr().out
    mesh, about = PlyData.read(str(folder / "mesh.ply")), json.loads((folder / "mesh.json").read_text())
    assert seal_of(about) == about["seal"]
    assert [each.name for each in mesh["vertex"].properties] == ["x", "y", "z", "nx", "ny", "nz"]
    assert (len(mesh["vertex"]), len(mesh["face"])) == (about["vertices"], about["faces"])
    centre = np.stack([mesh["vertex"][name] for name in "xyz"]).mean(-1)
    assert np.abs(centre).max() < 1, "the solids lie in a cube around the origin"
    shape = about["shape"]
    assert 0 < shape["chamfer"] == (shape["accuracy"] + shape["completeness"]) / 2 < 0.1
    assert "Chamfer distance" in said
    assert "solids" in said


def test_settings_of_a_mesh_are_shares_of_the_extent(folder: Path, tmp_path: Path) -> None:
    sizes = ["--voxel", "0.02", "--truncation", "3", "--views", "test", "--file", str(tmp_path / "coarse.ply")]
    assert main(["export", str(folder), "--mesh", *sizes]) == 0
    about = json.loads((tmp_path / "coarse.json").read_text())
    assert about["voxel"] == pytest.approx(0.02 * about["extent"])
    assert about["truncation"] == pytest.approx(3 * about["voxel"])


@pytest.mark.parametrize(
    ("options", "code", "complaint"),
    [
        (["--memory", "0.00001"], 2, "than the"),
        (["--voxel", "0.0001"], 2, "finer than"),
        (["--voxel", "-1"], 2, "not a number above zero"),
        (["--truncation", "1"], 2, "truncation is 1 voxels"),
    ],
)
def test_a_mesh_that_cannot_be_made_is_explained(
    options: list[str], code: int, complaint: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(folder), "--mesh", "--views", "test", *options]) == code
    assert complaint in capsys.readouterr().err


@pytest.mark.slow
def test_relighting_a_scene_without_masks_prints_a_warning(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its surroundings are part of the model, so that light from outside means little. One line states it."""
    photos = tmp_path / "photos"
    assert main(["datasets", "convert", "convex", "--to", "blender", "--out", str(photos), "--reduce", "4"]) == 0
    for path in photos.rglob("*.png"):
        write_png(path, read_image(path)[..., :3])
    write_hdr(tmp_path / "dim.hdr", np.full((8, 16, 3), 0.05, np.float32))
    out = tmp_path / "model"
    assert main(["train", str(photos), "--preset", "smoke", "--out", str(out)]) == 0
    capsys.readouterr()
    assert main(["relight", str(out), "--envmap", str(tmp_path / "dim.hdr"), "--mode", "pbr"]) == 0
    assert "relighting means little here: the scene has no masks" in capsys.readouterr().out
