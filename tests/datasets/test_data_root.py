"""Scenes are named by their data set from anywhere; what lies here comes first, and doubt is an error."""

import shutil
from pathlib import Path

import pytest

from radiogs_bench.cli import main
from radiogs_bench.suites.registry import SUITES
from radiogs_bench.suites.scenes import own_scenes, place_of
from radiogs_core.errors import DataError
from radiogs_datasets import load_scene
from radiogs_datasets.data_root import data_root, using_data_root
from radiogs_datasets.registry import TINY, located


def put(folder: Path, scene: str = "convex") -> Path:
    """A copy of a scene, by links to its files."""
    shutil.copytree(TINY / scene, folder, copy_function=lambda source, target: Path(target).symlink_to(source))
    return folder


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("RADIOGS_BENCH_DATA", str(tmp_path / "data"))
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    for name in ("armadillo", "ficus", "hotdog", "lego"):
        put(tmp_path / "data" / "tensoir" / name)
    return tmp_path / "data"


def test_a_scene_is_found_by_its_data_set(root: Path) -> None:
    scene = load_scene("tensoir/lego")
    assert scene.folder == root / "tensoir" / "lego"
    assert scene.name == "lego"
    assert place_of("tensoir/lego") == str(root / "tensoir" / "lego")


def test_a_folder_that_is_here_comes_before_the_root_and_miniatures_before_both(root: Path) -> None:
    put(Path("tensoir/lego"), "occluder")
    assert located("tensoir/lego") == Path("tensoir/lego")
    put(root / "convex", "occluder")
    assert load_scene("convex").folder == TINY / "convex"


def test_folders_between_a_data_set_and_its_scenes_are_looked_into(root: Path) -> None:
    deep = put(root / "stanford-orb" / "blender_LDR" / "cup_scene003")
    (root / "stanford-orb" / "ground_truth" / "cup_scene003").mkdir(parents=True)  # no scene
    assert located("stanford-orb/cup_scene003") == deep
    put(root / "stanford-orb" / "blender_HDR" / "cup_scene003")
    with pytest.raises(DataError, match="there are 2 scenes") as raised:
        located("stanford-orb/cup_scene003")
    assert "stanford-orb/blender_HDR/cup_scene003" in raised.value.why
    assert located("stanford-orb/blender_LDR/cup_scene003") == deep


def test_a_name_alone_is_looked_for_in_each_data_set(root: Path) -> None:
    assert located("lego") == root / "tensoir" / "lego"
    assert located("cup") is None
    put(root / "blender" / "lego", "occluder")
    with pytest.raises(DataError, match="there are 2 scenes 'lego'") as raised:
        load_scene("lego")
    assert "blender/lego, tensoir/lego" in raised.value.why
    assert own_scenes(SUITES["tensoir"])[3] == "tensoir/lego", "the suite's own data set decides"
    with pytest.raises(DataError, match="there is no scene 'cup'") as raised:
        load_scene("cup")
    assert str(root) in raised.value.why


def test_a_suite_finds_its_scenes_in_the_root(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert own_scenes(SUITES["tensoir"]) == ("tensoir/armadillo", "tensoir/ficus", "tensoir/hotdog", "tensoir/lego")
    put(Path("lego"))
    assert own_scenes(SUITES["tensoir"])[3] == "lego"
    with pytest.raises(DataError, match="not here") as raised:
        own_scenes(SUITES["synthetic4relight"])
    assert "datasets fetch synthetic4relight --data ROOT" in raised.value.remedy
    monkeypatch.delenv("RADIOGS_BENCH_DATA")
    with pytest.raises(DataError, match="not here"):
        own_scenes(SUITES["tensoir"])


@pytest.mark.slow
def test_the_option_comes_before_the_variable_and_lasts_for_the_command(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other"
    put(other / "tensoir" / "lego", "occluder")
    assert main(["datasets", "check", "tensoir/lego", "--data", str(other)]) == 0
    assert load_scene("occluder").checksum in capsys.readouterr().out
    assert data_root() == root
    assert main(["datasets", "check", "tensoir/lego"]) == 0
    assert load_scene("convex").checksum in capsys.readouterr().out
    assert main(["datasets", "check", "tensoir/lego", "--data", str(tmp_path / "none")]) == 3
    assert "there is no folder" in capsys.readouterr().err


def test_without_a_root_the_message_names_the_variable(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("RADIOGS_BENCH_DATA", raising=False)
    with pytest.raises(DataError, match="no scene") as raised:
        load_scene("tensoir/lego")
    assert "RADIOGS_BENCH_DATA" in raised.value.why
    with using_data_root(tmp_path):
        assert data_root() == tmp_path
    assert data_root() is None


def test_a_folder_that_is_still_to_be_made_is_enough_for_a_plan(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("RADIOGS_BENCH_DATA", raising=False)
    absent = str(tmp_path / "data")
    planned = ["run", "tensoir", "--data", absent, "--device", "cuda", "--out", str(tmp_path / "out")]
    assert main([*planned, "--dry-run"]) == 0
    assert "not here: armadillo" in capsys.readouterr().out
    assert main(planned) == 3
    assert f"there is no folder '{absent}'" in capsys.readouterr().err
