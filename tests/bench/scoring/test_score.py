"""Anybody's folder: the same prediction scores the same whichever layout carried it, and nothing is guessed."""

import json
import pickle
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from public_outputs import WRITERS, noisy, png
from radiogs_baselines.outputs.codes import CODES
from radiogs_baselines.outputs.reading import likely_codes, read_predictions
from radiogs_bench.cli import main
from radiogs_bench.scoring.metrics.protocols import PROTOCOLS, protocol
from radiogs_bench.scoring.score_files import score_predictions
from radiogs_bench.scoring.score_maps import coverage
from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Scene
from radiogs_datasets import load_scene

TOLERANCE = {"psnr": 0.02, "ssim": 1e-3, "mae": 0.02, "mse": 2e-5, "delta_e": 0.3}
"""Differences that 8 bits a second time may make (albedo as sRGB; white taken away at soft edges): an added error of
variance 1 / (12 255^2) beside the noise of 0.05^2 is 0.002 dB; edges add up to ten times that at 96 x 96 pixels."""


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene("corner")


@pytest.fixture(scope="module")
def folders(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    predicted, found = noisy(scene), {}
    for code, write in WRITERS.items():
        found[code] = tmp_path_factory.mktemp(code)
        write(found[code], predicted)
    return found


def figures(folder: Path, scene: Scene, code: str | None = None) -> dict[str, float | None]:
    (score,) = score_predictions(read_predictions(folder, scene, code), scene, [protocol("default")])
    return {name: metric["value"] for name, metric in score.metrics.items()}


def test_every_reader_has_a_writer_to_be_tested_with() -> None:
    assert set(WRITERS) == set(CODES)


@pytest.mark.parametrize("code", list(WRITERS))
def test_the_code_of_a_folder_is_recognised_from_its_files(code: str, folders: dict[str, Path]) -> None:
    assert likely_codes(folders[code]) == [code]


@pytest.mark.slow
@pytest.mark.parametrize("code", list(WRITERS))
def test_the_same_prediction_scores_the_same_in_every_layout(code: str, folders: dict[str, Path], scene: Scene) -> None:
    ours, reference = figures(folders[code], scene), figures(folders["plain"], scene)
    expected = {"albedo/psnr", "relight/psnr", "relight/sunset/psnr", "normal/mae", "roughness/mse"}
    # R3DG gives all views of this layout one name, and its indexed images are not the physically based ones.
    assert expected | ({"nvs/psnr"} if code != "r3dg" else set()) <= ours.keys()
    assert ours.keys() <= reference.keys()
    for name, value in ours.items():
        measure = name.rsplit("/", 1)[1]
        if measure == "lpips":
            continue
        assert value is not None
        assert reference[name] is not None
        assert value == pytest.approx(reference[name], abs=TOLERANCE[measure]), name
    assert 20 < ours["relight/psnr"] < 35, "the noise is there"


def test_indirect_light_is_read_as_outgoing_or_incident_as_the_protocol_compares(
    folders: dict[str, Path], scene: Scene
) -> None:
    predictions = read_predictions(folders["radiogs"], scene)
    outgoing, incident = score_predictions(predictions, scene, [protocol("default"), protocol("radiogs")])
    best, half = outgoing.metrics["indirect/psnr"]["value"], incident.metrics["indirect/psnr"]["value"]
    assert best is not None
    assert half is not None
    assert best > 45
    assert half < 30


def test_a_view_without_its_file_leaves_no_mean_and_is_named(
    folders: dict[str, Path], scene: Scene, tmp_path: Path
) -> None:
    WRITERS["irgs"](tmp_path, noisy(scene))
    (tmp_path / "test/ours_20000/render/00003.png").unlink()
    predictions = read_predictions(tmp_path, scene)
    assert predictions.missing == ("image: test/ours_20000/render/00003.png",)
    (score,) = score_predictions(predictions, scene, [protocol("default")])
    metric = score.metrics["nvs/psnr"]
    assert metric["value"] is None
    assert metric["reason"]
    assert [place for place, value in enumerate(metric["views"]) if value is None] == [3]


def test_maps_that_no_view_has_are_absent_and_named(folders: dict[str, Path], scene: Scene) -> None:
    predictions = read_predictions(folders["plain"], scene)
    name = scene.test[0].name
    assert predictions.absent == (f"depth (depth/{name})", f"incident (incident/{name})")
    assert predictions.missing == ()


def test_the_iteration_with_the_largest_number_is_read(scene: Scene, tmp_path: Path) -> None:
    predicted = noisy(scene)
    WRITERS["irgs"](tmp_path, predicted)
    for index, maps in enumerate(predicted.values()):
        png(tmp_path / f"test/ours_7000/render/{index:05d}.png", 0 * maps["image"])
    found = read_predictions(tmp_path, scene).maps[scene.test[0].name]["image"]
    assert "ours_20000" in str(found.path)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("place", "first"),
    [
        ("render/{name}", "render/test_000.png"),
        ("renders/{index:05d}", "renders/00000.png"),
        ("image/{index:03d}", "image/000.png"),
        ("{name}", "test_000.png"),
        ("{index}", "0.png"),
    ],
)
def test_plain_images_are_read_by_name_or_number_with_a_remark(
    place: str, first: str, folders: dict[str, Path], scene: Scene, tmp_path: Path
) -> None:
    """Numbers are places in the order of the test views; ``relit`` may be numbered likewise."""
    for index, view in enumerate(scene.test):
        for kind, lies in (("image", place), ("relit/sunset", "relit/sunset/{index:05d}")):
            file = tmp_path / f"{lies.format(name=view.name, index=index)}.png"
            file.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(folders["plain"] / kind / f"{view.name}.png", file)
    predictions = read_predictions(tmp_path, scene)
    assert (predictions.code, predictions.missing, predictions.ignored) == ("plain", (), ())
    assert predictions.remarks == (
        f"image: {first} is read as view 'test_000'",
        "relit under sunset: relit/sunset/00000.png is read as view 'test_000'",
    )
    found, reference = figures(tmp_path, scene), figures(folders["plain"], scene)
    for metric in ("nvs/psnr", "relight/sunset/psnr"):
        assert found[metric] == reference[metric] is not None


def test_views_whose_names_are_numbers_are_read_by_their_place_where_only_that_is_complete(
    folders: dict[str, Path], scene: Scene, tmp_path: Path
) -> None:
    """Every second photo of a capture was held out: 00000, 00002, ...; its renders are numbered 00000, 00001, ..."""
    renamed = replace(scene, test=tuple(replace(view, name=f"{2 * k:05d}") for k, view in enumerate(scene.test)))
    for index, view in enumerate(scene.test):
        shutil.copy(folders["plain"] / "image" / f"{view.name}.png", tmp_path / f"{index:05d}.png")
    predictions = read_predictions(tmp_path, renamed)
    assert predictions.remarks == ("image: 00000.png is read as view '00000'",)
    assert [predictions.maps[view.name]["image"].path.name for view in renamed.test] == [
        f"{index:05d}.png" for index in range(len(scene.test))
    ]
    last = len(scene.test)
    shutil.copy(tmp_path / "00000.png", tmp_path / f"{last:05d}.png")
    with pytest.raises(DataError, match=f"counts views up to {last}"):
        read_predictions(tmp_path, renamed)


def test_images_without_a_view_are_listed_with_the_expected_names(
    folders: dict[str, Path], scene: Scene, tmp_path: Path
) -> None:
    for view in scene.test:
        shutil.copy(folders["plain"] / "image" / f"{view.name}.png", tmp_path / f"frame-of-{view.name}.png")
    with pytest.raises(DataError) as refused:
        read_predictions(tmp_path, scene)
    assert f"frame-of-test_*.png ({len(scene.test)} files)" in refused.value.why
    assert f"'test_000.png', ...) or number them from 0 to {len(scene.test) - 1}" in refused.value.remedy


@pytest.mark.parametrize("damage", ["truncated", "size", "text"])
def test_a_damaged_file_is_an_error_and_never_a_score(damage: str, scene: Scene, tmp_path: Path) -> None:
    WRITERS["plain"](tmp_path, noisy(scene))
    file = tmp_path / f"image/{scene.test[0].name}.png"
    if damage == "truncated":
        file.write_bytes(file.read_bytes()[:200])
    elif damage == "size":
        png(file, torch.zeros(16, 16, 3))
    else:
        file.write_text("no image")
    with pytest.raises(DataError, match=scene.test[0].name):
        figures(tmp_path, scene)


def test_a_pickle_in_a_stored_file_is_not_executed(scene: Scene, tmp_path: Path) -> None:
    class Evil:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return (Path.touch, (tmp_path / "ran",))  # type: ignore[return-value]

    WRITERS["plain"](tmp_path, noisy(scene))
    file = tmp_path / f"roughness/{scene.test[0].name}.npy"
    for content in (pickle.dumps(Evil()), None):
        if content is None:
            np.save(file, np.array([Evil()], dtype=object), allow_pickle=True)
        else:
            file.write_bytes(content)
        with pytest.raises(DataError, match="roughness"):
            figures(tmp_path, scene)
    assert not (tmp_path / "ran").exists()


def test_normals_in_any_encoding_are_directions(folders: dict[str, Path], scene: Scene) -> None:
    view = scene.test[0]
    normal = read_predictions(folders["plain"], scene).read(view, coverage(view))["normal"]
    solid = view.read("alpha")[..., 0] == 1
    torch.testing.assert_close(normal.norm(dim=-1)[solid], torch.ones(int(solid.sum())), rtol=0, atol=1e-5)


@pytest.mark.slow
def test_the_command_writes_its_record(
    folders: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record = tmp_path / "score.json"
    given = ["score", str(folders["gi-gs"]), "--scene", "corner", "--protocol", "all", "--out", str(record)]
    assert main(given) == 0
    content = json.loads(record.read_text())
    assert content["schema"] == "radiogs-bench/score/1"
    assert content["from"] == "gi-gs"
    assert set(content["protocols"]) == set(PROTOCOLS)
    assert len(content["protocols"]["default"]["metrics"]["nvs/psnr"]["views"]) == len(content["views"])
    assert content["files"]["image"]["test_000"] == "test/ours_None/pbr/00000.png"
    assert len(content["scene"]["checksum"]) == 64
    assert {type(content[name]) for name in ("remarks", "absent", "missing", "ignored")} == {list}
    shown = capsys.readouterr().out
    assert "ignored: test/ours_None/normal/*_normal.png (8 files): normals clamped" in shown
    assert "nvs/psnr" in shown
    assert main([*given[:-4], "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["scene"]["name"] == "corner"


def test_the_folder_of_missing_weights_is_printed_and_not_recorded(
    folders: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("RADIOGS_BENCH_WEIGHTS", str(tmp_path))
    assert main(["score", str(folders["plain"]), "--scene", "corner", "--json"]) == 0
    shown = capsys.readouterr()
    assert str(tmp_path) in shown.err
    record = json.loads(shown.out)
    assert "not found" in record["protocols"]["default"]["metrics"]["nvs/lpips"]["reason"]
    assert str(tmp_path) not in json.dumps(record["protocols"])


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["nowhere", "--scene", "corner"], 3, "there is no folder"),
        (["."], 2, "no scene was named"),
        ([".", "--scene", "corner"], 3, "cannot tell which code"),
        ([".", "--scene", "corner", "--from", "irgz"], 2, "Did you mean 'irgs'"),
        ([".", "--scene", "corner", "--from", "irgs"], 3, "holds no prediction"),
        ([".", "--scene", "corner", "--protocol", "best"], 2, "unknown metric protocol"),
        ([".", "--from", "stanford-orb"], 3, "no Stanford-ORB results"),
    ],
)
def test_wrong_calls_are_explained(
    arguments: list[str],
    code: int,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["score", *arguments]) == code
    assert said in capsys.readouterr().err


def test_a_missing_prediction_is_not_called_a_missing_truth(
    folders: dict[str, Path], scene: Scene, tmp_path: Path
) -> None:
    """Audit M38: for a missing prediction of a view, the message blamed a missing truth."""
    folder = Path(shutil.copytree(folders["plain"], tmp_path / "plain"))
    view = scene.test[1].name
    for name in ("image", "normal", "albedo"):
        next((folder / name).glob(f"{view}.*")).unlink()
    (score,) = score_predictions(read_predictions(folder, scene, "plain"), scene, [protocol("default")])
    for task, name in (("nvs/psnr", "image"), ("normal/mae", "normal")):
        assert score.metrics[task]["reason"] == f"there is no prediction of '{name}' for view '{view}'"
    assert score.metrics["roughness/mse"]["value"] is not None
    assert "ground truth" not in (score.metrics["albedo/psnr"]["reason"] or "")
