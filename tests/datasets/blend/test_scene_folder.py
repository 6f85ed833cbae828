"""The folder of a rendered file, with pictures of known passes in Blender's place."""

import json
import shutil
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
import torch

from datasets.blend.multilayer import passes, write_multilayer
from radiogs_bench.cli import main
from radiogs_bench.cli.datasets import remarks
from radiogs_core.errors import DataError, UsageError
from radiogs_datasets import load_scene
from radiogs_datasets.blend import scene_folder
from radiogs_datasets.blend.passes import read_passes
from radiogs_datasets.blend.process import Blender
from radiogs_datasets.blend.request import Request
from radiogs_datasets.blend.scene_folder import write_scene
from radiogs_datasets.check import check_scene

OPENED = {
    "blender": "5.0.1", "scene": "Scene", "low": [-1.0] * 3, "high": [1.0] * 3, "objects": 1, "instances": 0,
    "unit_scale": 1.0, "unit_system": "METRIC", "scripts": 2, "lamps": 1, "cameras": 0, "volumes": 0,
    "other_scenes": 0, "materials": 3, "not_understood": {"ShaderNodeBsdfHair": 1},
}  # fmt: skip


class Pictures(Blender):
    """Takes Blender's place: each picture is grey, a little other for each seed and light; it dies at a count."""

    taken: ClassVar[list[dict[str, Any]]] = []
    dies_after = 1000

    def __init__(self, log: Path) -> None:
        self.log = log

    def __enter__(self) -> "Pictures":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def ask(self, task: str, **given: Any) -> Any:
        if task == "open":
            return OPENED
        if len(Pictures.taken) >= Pictures.dies_after:
            raise DataError("Blender's process ended by itself", "It was killed.", "Run it again.")
        Pictures.taken.append(given)
        made = passes(given["size"])
        made["Combined"][..., :3] *= 1 + 1e-3 * (given["seed"] % 7) + 0.01 * (given["bounces"] > 12)
        made["metallic"][:] = 0.25
        made["Combined"][0] = made["albedo"][0] = 0
        made["Diffuse Color"][0] = made["known"][0] = 0
        write_multilayer(Path(given["out"]), made)
        return None


@pytest.fixture
def asked(tmp_path: Path, lights: Path, monkeypatch: pytest.MonkeyPatch) -> Request:
    monkeypatch.setattr(scene_folder, "Blender", Pictures)
    monkeypatch.setattr(scene_folder, "require_blender", lambda: None)
    monkeypatch.setattr(Pictures, "taken", [])
    monkeypatch.setattr(Pictures, "dies_after", 1000)
    (tmp_path / "scene.blend").write_bytes(b"a file")
    return Request(tmp_path / "scene.blend", lights, train=3, test=2, size=16, samples=4)


def ignore(done: int, total: int) -> None:
    pass


@pytest.mark.parametrize(("test_samples", "counts"), [(0, {4: 10}), (9, {4: 3, 9: 7})])
def test_test_views_have_samples_of_their_own(
    asked: Request, tmp_path: Path, test_samples: int, counts: dict[int, int]
) -> None:
    """Three training views, two test views under two lights each, and three pictures for noise and deeper light."""
    made = write_scene(replace(asked, test_samples=test_samples), tmp_path / "made", 1, 1, ignore)
    assert Counter(each["samples"] for each in Pictures.taken) == counts
    assert (made["samples"], made["test_samples"]) == (4, test_samples)


def test_what_is_written_is_a_sound_scene_with_every_map(asked: Request, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    write_scene(asked, tmp_path / "made", 2, 1, lambda done, total: told.append((done, total)))
    assert told == [(number, 5) for number in range(1, 6)]
    scene = load_scene(str(tmp_path / "made"))
    assert check_scene(str(tmp_path / "made")).sound
    assert (len(scene.train), len(scene.test), [*scene.lights]) == (3, 2, ["spot"])
    view = scene.test[0]
    covered = view.read("alpha")[..., 0] > 0
    for name, value in {"albedo": 0.5, "depth": 3.0, "direct": 0.45, "indirect": 0.05, "roughness": 0.4}.items():
        assert view.read(name)[covered].mean() == pytest.approx(value, abs=3e-3), name
    assert view.read("normal")[covered].mean(0).tolist() == pytest.approx([0, 0, 1], abs=0.01)
    assert view.has("relit/spot")
    assert view.has("relit/spot/indirect")
    assert torch.equal(scene.training_light.radiance, torch.ones(16, 32, 3))
    assert not list((tmp_path / "made").glob(".*"))


def test_the_metadata_records_the_measurements(asked: Request, tmp_path: Path) -> None:
    found = write_scene(asked, tmp_path / "made", 1, 1, ignore)
    assert json.loads((tmp_path / "made" / "metadata.json").read_text()) == json.loads(json.dumps(found))
    assert found["energy_of_what_the_brdf_cannot_say"] == {"metallic": pytest.approx(0.25, abs=1e-3)}
    assert found["indirect_share"] == pytest.approx(0.1, abs=1e-3)
    assert found["energy_beyond_bounces"] == pytest.approx(0.01, abs=1e-3)
    assert 40 < found["noise_floor_db"] < 80
    said = "\n".join(remarks(found))
    for words in (
        "25.0% of the light",
        "scripts and Python drivers, not run: 2",
        "the map is the light: 1",
        "ShaderNodeBsdfHair",
        "beyond 12 bounces: 0.99%",
    ):
        assert words in said


def test_every_pass_can_be_kept(asked: Request, tmp_path: Path) -> None:
    write_scene(replace(asked, keep_passes=True), tmp_path / "made", 1, 1, ignore)
    kept = sorted(path.name for path in (tmp_path / "made.passes").iterdir())
    assert kept == ["test_000.exr", "test_001.exr"]
    found = read_passes(tmp_path / "made.passes" / "test_000.exr")
    assert found["Diffuse Indirect"].mean() == pytest.approx(0.1, rel=1e-5)
    assert check_scene(str(tmp_path / "made")).sound


def test_lights_of_a_view_share_their_random_numbers_and_views_do_not(asked: Request, tmp_path: Path) -> None:
    write_scene(asked, tmp_path / "made", 1, 1, ignore)
    seeds = [task["seed"] for task in Pictures.taken]
    # Three training views; two test views under two lights; then noise and bounces on the first test view.
    assert seeds[:7] == [0, 1, 2, 3, 3, 4, 4]
    assert seeds[7] == seeds[9] == 3
    assert seeds[8] not in seeds[:8]


def test_a_command_that_died_goes_on_where_it_was(
    asked: Request, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = tmp_path / "whole"
    write_scene(asked, whole, 1, 1, ignore)
    Pictures.taken.clear()
    monkeypatch.setattr(Pictures, "dies_after", 4)
    with pytest.raises(DataError, match="ended by itself"):
        write_scene(asked, tmp_path / "made", 1, 1, ignore)
    assert not (tmp_path / "made").exists()
    monkeypatch.setattr(Pictures, "dies_after", 1000)
    write_scene(asked, tmp_path / "made", 1, 1, ignore)
    # The test view that was not finished is rendered again: 4 + (2 + 2 pictures of test views) + 3 measured ones.
    assert len(Pictures.taken) == 4 + 4 + 3
    assert files(tmp_path / "made") == files(whole)


def files(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("other", [{"samples": 5}, {"seed": 1}, {"training_light": "spot"}])
def test_a_folder_begun_for_another_request_is_left_alone(
    asked: Request, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, other: dict[str, Any]
) -> None:
    monkeypatch.setattr(Pictures, "dies_after", 2)
    with pytest.raises(DataError):
        write_scene(asked, tmp_path / "made", 1, 1, ignore)
    before = files(tmp_path / "made.unfinished")
    with pytest.raises(UsageError, match="begun with other options"):
        write_scene(replace(asked, **other), tmp_path / "made", 1, 1, ignore)
    assert files(tmp_path / "made.unfinished") == before


def test_a_folder_without_a_finished_view_is_begun_anew(
    asked: Request, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Pictures, "dies_after", 0)
    with pytest.raises(DataError):
        write_scene(asked, tmp_path / "made", 1, 1, ignore)
    monkeypatch.setattr(Pictures, "dies_after", 1000)
    assert write_scene(replace(asked, samples=5), tmp_path / "made", 1, 1, ignore)["samples"] == 5


def test_nothing_is_written_over_files(asked: Request, tmp_path: Path) -> None:
    (tmp_path / "made").mkdir()
    (tmp_path / "made" / "mine").write_text("mine")
    with pytest.raises(UsageError, match="exists already"):
        write_scene(asked, tmp_path / "made", 1, 1, ignore)


def test_a_folder_of_that_name_that_is_not_ours_is_left_alone(asked: Request, tmp_path: Path) -> None:
    mine = tmp_path / "made.unfinished"
    mine.mkdir()
    (mine / "thesis.txt").write_text("mine")
    with pytest.raises(UsageError, match=r"made\.unfinished exists already"):
        write_scene(asked, tmp_path / "made", 1, 1, ignore)
    assert files(mine) == {"thesis.txt": b"mine"}
    shutil.move(mine, tmp_path / "elsewhere")
    mine.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(UsageError, match="is a link"):
        write_scene(asked, tmp_path / "made", 1, 1, ignore)
    assert files(tmp_path / "elsewhere") == {"thesis.txt": b"mine"}


@pytest.fixture
def said(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    def command(*arguments: str) -> tuple[int, str]:
        code = main(["datasets", "blend", *arguments])
        printed = capsys.readouterr()
        return code, printed.out + printed.err

    return command


def test_the_command_writes_any_layout_and_prints_remarks(
    asked: Request, tmp_path: Path, said: Callable[..., tuple[int, str]]
) -> None:
    size = ["--views", "2", "--test", "1", "--size", "16"]
    code, printed = said(str(asked.file), "--out", str(tmp_path / "a"), "--lights", str(asked.lights), *size)
    assert code == 0
    assert "noise: " in printed
    code, printed = said(str(asked.file), "--out", str(tmp_path / "b"), *size, "--layout", "blender")
    assert code == 0
    assert "depth of 1 test views has no place" in printed
    assert len(load_scene(str(tmp_path / "b")).train) == 2
    # Without --lights, those of the miniatures.
    assert [*load_scene(str(tmp_path / "b.tensoir")).lights] == ["overcast", "sunset"]


def test_the_command_s_mistakes_end_with_their_codes(
    asked: Request, tmp_path: Path, said: Callable[..., tuple[int, str]]
) -> None:
    assert said(str(tmp_path / "absent.blend"), "--out", str(tmp_path / "a"))[0] == 3
    code, printed = said(str(asked.file), "--out", str(tmp_path / "a"), "--layout", "nerf")
    assert (code, "'nerf' for --layout" in printed) == (2, True)
    assert said(str(asked.file), "--out", str(tmp_path / "a"), "--lights", str(tmp_path / "none"))[0] == 2


def test_a_view_is_black_where_nothing_is(asked: Request, tmp_path: Path) -> None:
    write_scene(asked, tmp_path / "made", 1, 1, ignore)
    view = load_scene(str(tmp_path / "made")).test[0]
    assert not view.read("alpha")[0].any()
    assert not view.read("indirect")[0].any()
    assert np.isfinite(view.read("albedo").numpy()).all()
