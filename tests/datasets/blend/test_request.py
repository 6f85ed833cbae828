"""The fields of a request, and when two requests are the same."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from radiogs_core.errors import DataError, UsageError
from radiogs_datasets.blend.request import Request


@pytest.fixture
def asked(tmp_path: Path, lights: Path) -> Request:
    (tmp_path / "scene.blend").write_bytes(b"a file")
    return Request(tmp_path / "scene.blend", lights)


def test_the_training_light_is_first(asked: Request) -> None:
    assert [*asked.light_files] == ["training", "spot"]
    assert [*replace(asked, training_light="spot").light_files] == ["spot", "training"]
    (asked.lights / "training.hdr").unlink()
    assert [*replace(asked).light_files] == ["spot"]


def test_lights_that_are_not_there_are_named(asked: Request, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no light 'moon'") as caught:
        _ = replace(asked, training_light="moon").light_files
    assert "spot, training" in str(caught.value)
    with pytest.raises(UsageError, match="holds no light"):
        _ = replace(asked, lights=tmp_path).light_files
    with pytest.raises(UsageError, match="holds no light"):
        _ = replace(asked, lights=tmp_path / "absent").light_files
    shutil.copy(asked.lights / "spot.hdr", asked.lights / "spot.exr")
    with pytest.raises(UsageError, match="one name"):
        _ = replace(asked).light_files


@pytest.mark.parametrize(
    "other",
    [{"training_light": "spot"}, {"cameras": "fit"}, {"train": 3}, {"test": 3}, {"size": 8}, {"samples": 3},
     {"bounces": 3}, {"seed": 3}, {"device": "cuda"}, {"keep_passes": True}],
)  # fmt: skip
def test_every_option_is_part_of_the_identity(asked: Request, other: dict[str, object]) -> None:
    assert replace(asked, **other).identity() != asked.identity()  # type: ignore[arg-type]


def test_contents_are_part_of_the_identity_and_places_are_not(asked: Request, tmp_path: Path) -> None:
    moved = tmp_path / "moved"
    shutil.copytree(asked.lights, moved / "lights")
    shutil.copy(asked.file, moved / "other.blend")
    elsewhere = replace(asked, file=moved / "other.blend", lights=moved / "lights")
    assert elsewhere.identity() == asked.identity()
    elsewhere.file.write_bytes(b"another file")
    assert replace(elsewhere).identity() != asked.identity()
    elsewhere.file.write_bytes(b"a file")
    shutil.copy(moved / "lights" / "spot.hdr", moved / "lights" / "training.hdr")
    assert replace(elsewhere).identity() != asked.identity()


def test_a_file_that_cannot_be_read_is_an_error(asked: Request, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="cannot read"):
        replace(asked, file=tmp_path / "absent.blend").identity()
