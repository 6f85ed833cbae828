"""Stanford-ORB's pairs of files: the published example, and a capture made here."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from radiogs_baselines.outputs.stanford_orb import read_pairs
from radiogs_bench.cli import main
from radiogs_bench.scoring.metrics.protocols import PROTOCOLS, protocol
from radiogs_bench.scoring.score_orb import score_pairs
from radiogs_core.errors import DataError
from radiogs_datasets.image_files import read_image, write_exr, write_png

SIZE = 64
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


@pytest.fixture
def handed_in(tmp_path: Path) -> Path:
    """A capture whose results are the truth, four times as large where the benchmark has 2048 pixels."""
    generator = np.random.default_rng(0)
    image = generator.uniform(0.1, 0.9, (SIZE, SIZE, 3)).astype(np.float32)
    # 16-pixel blocks, so that an area mean of 4 x 4 is exact.
    image = np.kron(image[::16, ::16], np.ones((16, 16, 1), np.float32))
    large = np.kron(image, np.ones((4, 4, 1), np.float32))
    normal = np.tile(np.array([0.0, 0.6, 0.8], np.float32), (SIZE, SIZE, 1))
    depth = generator.uniform(3, 4, (SIZE, SIZE, 1)).astype(np.float32)
    for name in ("truth/test", "truth/test_mask", "truth/albedo", "mine"):
        (tmp_path / name).mkdir(parents=True)
    write_exr(tmp_path / "truth/test/0000.exr", large)
    write_png(tmp_path / "truth/test_mask/0000.png", np.ones((4 * SIZE, 4 * SIZE, 1), np.float32))
    write_png(tmp_path / "truth/albedo/0000.png", large)
    np.save(tmp_path / "truth/z.npy", np.kron(depth[..., 0], np.ones((4, 4), np.float32)))
    np.save(tmp_path / "truth/n.npy", np.kron(normal, np.ones((4, 4, 1), np.float32)))
    (tmp_path / "truth/mesh.obj").write_text(OBJ)
    write_exr(tmp_path / "mine/view.exr", image)
    write_exr(tmp_path / "mine/light.exr", 0.5 * image)
    write_png(tmp_path / "mine/kd.png", image)
    write_exr(tmp_path / "mine/z.exr", 2 * depth)
    write_exr(tmp_path / "mine/n.exr", normal)
    (tmp_path / "mine/mesh.obj").write_text(OBJ)
    mask = "elsewhere/truth/test_mask/0000.png"
    entries = {
        "view": [{"output_image": "elsewhere/mine/view.exr", "target_image": "elsewhere/truth/test/0000.exr"}],
        "light": [{"output_image": "elsewhere/mine/light.exr", "target_image": "elsewhere/truth/test/0000.exr"}],
        "material": [
            {"output_image": "elsewhere/mine/kd.png", "target_image": "elsewhere/truth/albedo/0000.png",
             "target_mask": mask}
        ],
        "geometry": [
            {"output_depth": "elsewhere/mine/z.exr", "target_depth": "elsewhere/truth/z.npy",
             "output_normal": "elsewhere/mine/n.exr", "target_normal": "elsewhere/truth/n.npy", "target_mask": mask}
        ],
        "shape": {"output_mesh": "elsewhere/mine/mesh.obj", "target_mesh": "elsewhere/truth/mesh.obj"},
    }  # fmt: skip
    file = tmp_path / "mine.json"
    file.write_text(json.dumps({"info": {"cube": entries}}))
    return file


def test_the_truth_scores_perfectly_and_scales_do_not_count_where_they_may_not(handed_in: Path) -> None:
    metrics = score_pairs(read_pairs(handed_in), protocol("stanford-orb"))
    values = {name.removeprefix("cube/"): metric["value"] for name, metric in metrics.items()}
    assert values["nvs/psnr_h"] > 60
    assert values["relight/psnr_l"] > 60, "relit images are aligned a channel"
    assert values["albedo/psnr"] > 45, "8 bits"
    assert values["normal/cosine"] == pytest.approx(0, abs=1e-5)
    assert values["depth/simse"] == pytest.approx(0, abs=1e-5), "half floats, twice the depth"
    # Points on a surface against its four vertices: never zero, and bounded by the edges.
    assert 0 < values["shape/chamfer"] < 1


def with_outputs(file: Path, **outputs: Any) -> Path:
    """The JSON with other outputs, by the kind of entry."""
    info = json.loads(file.read_text())
    for kind, given in outputs.items():
        entries = info["info"]["cube"]
        entry = entries[kind] if kind == "shape" else entries[kind][0]
        entry.update(given)
    file.write_text(json.dumps(info))
    return file


def test_missing_predictions_are_white_or_left_out_as_in_the_evaluator(
    handed_in: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with_outputs(
        handed_in, view={"output_image": None}, material={"output_image": None},
        geometry={"output_depth": None}, shape={"output_mesh": None},
    )  # fmt: skip
    pairs = read_pairs(handed_in)
    values = {name: metric["value"] for name, metric in score_pairs(pairs, protocol("stanford-orb")).items()}
    # Ones against the truth, whose size here is below the benchmark's: a factor a channel for albedo, none for views.
    albedo = read_image(handed_in.parent / "truth/albedo/0000.png")[..., :3].astype(np.float64)
    linear = np.where(albedo <= 0.04045, albedo / 12.92, ((albedo + 0.055) / 1.055) ** 2.4)
    error = ((linear.mean((0, 1)) - linear) ** 2).mean()
    assert values["cube/albedo/psnr"] == pytest.approx(-10 * np.log10(error), abs=0.02)
    assert values["cube/nvs/psnr_l"] < 15
    assert values["cube/normal/cosine"] == pytest.approx(0, abs=1e-5)
    assert not {name for name in values if "/depth/" in name or "/shape/" in name}
    others = score_pairs(pairs, protocol("default"))
    assert others["cube/albedo/psnr"] == {"value": None, "reason": "the JSON gives null: there is no prediction",
                                          "views": [None]}  # fmt: skip
    assert main(["score", str(handed_in), "--from", "stanford-orb"]) == 0
    said = capsys.readouterr()
    assert "cube, depth: null is left out" in said.out + said.err
    assert "cube, albedo: null counts as a white image" in said.out + said.err


def test_albedo_in_an_exr_is_linear(handed_in: Path) -> None:
    target = read_image(handed_in.parent / "truth/albedo/0000.png")[::4, ::4, :3]
    linear = np.where(target <= 0.04045, target / 12.92, ((target + 0.055) / 1.055) ** 2.4)
    write_exr(handed_in.parent / "mine/kd.exr", linear.astype(np.float32))
    with_outputs(handed_in, material={"output_image": "elsewhere/mine/kd.exr"})
    for name in ("stanford-orb", "default"):
        assert score_pairs(read_pairs(handed_in), protocol(name))["cube/albedo/psnr"]["value"] > 60


def test_pairs_without_a_target_are_named_and_the_others_are_scored(handed_in: Path) -> None:
    (handed_in.parent / "truth/z.npy").unlink()
    pairs = read_pairs(handed_in)
    assert [pair.lacking for pair in pairs if pair.lacking] == [("elsewhere/truth/z.npy",)]
    metrics = score_pairs(pairs, protocol("default"))
    assert "cube/depth/simse" not in metrics
    assert "cube/normal/mae" in metrics


def test_one_record_has_every_protocol(handed_in: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["score", str(handed_in), "--protocol", "all", "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert set(record["protocols"]) == set(PROTOCOLS)
    assert record["files"]["cube/depth"] == {"elsewhere/truth/z.npy": "elsewhere/mine/z.exr"}
    assert record["protocols"]["tensoir"]["metrics"]["cube/nvs/psnr"]["value"] > 60


def test_validation_images_without_reference_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    grey = np.full((SIZE, SIZE, 3), 0.5, np.float32)
    for name in ("val_000000_opt", "val_000000_ref", "val_000001_opt", "val_000000_ks"):
        write_png(tmp_path / f"{name}.png", grey)
    assert main(["score", str(tmp_path), "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["missing"] == [f"{tmp_path.name} (own reference), nvs: val_000001_ref.png"]
    assert record["ignored"] == ["val_000000_ks.png"]
    views = record["protocols"]["default"]["metrics"][f"{tmp_path.name} (own reference)/nvs/psnr"]["views"]
    assert views == [100.0]


def test_pairs_take_no_scene(handed_in: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["score", str(handed_in), "--from", "stanford-orb", "--scene", "corner"]) == 2
    assert "name their own targets" in capsys.readouterr().err


@pytest.mark.parametrize(
    "content", ["", "[]", '{"info": {"a": {"view": [{}]}}}', '{"info": 3}', '{"info": {"a": {"view": 3}}}']
)
def test_a_json_of_another_kind_is_an_error(content: str, tmp_path: Path) -> None:
    file = tmp_path / "results.json"
    file.write_text(content)
    with pytest.raises(DataError):
        read_pairs(file)


def test_a_path_that_leads_out_of_the_folder_counts_as_missing(tmp_path: Path) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    (tmp_path / "secret.png").write_bytes(b"")
    entry = {"output_image": "../secret.png", "target_image": "../secret.png"}
    file = inner / "results.json"
    file.write_text(json.dumps({"info": {"a": {"view": [entry]}}}))
    (pair,) = read_pairs(file)
    assert pair.lacking == ("../secret.png", "../secret.png")


@pytest.mark.slow
def test_the_published_example_scores_as_in_its_own_log(
    shared_data: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(shared_data)
    assert main(["score", "stanford_orb_example", "--json", "--protocol", "all"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["from"] == "stanford-orb", "told by what it holds"
    metrics = record["protocols"]["default"]["metrics"]
    assert metrics["teapot_scene001 (own reference)/nvs/psnr"]["value"] == pytest.approx(31.93, abs=0.01)
    assert metrics["teapot_scene001/albedo/psnr"]["value"] > 30
    own = {name: each["metrics"] for name, each in record["protocols"].items()}
    # Both average one PSNR a channel; RadioGS cuts the truth to 8 bits, which it has already.
    for name in ("gs-ir", "radiogs"):
        assert own[name]["teapot_scene001 (own reference)/nvs/psnr"]["value"] == pytest.approx(31.952, abs=0.001)
    assert own["stanford-orb"]["teapot_scene001/albedo/psnr"]["value"] == pytest.approx(39.62, abs=0.01)
    assert len(record["missing"]) == 5
    assert any("z_maps/0000.npy" in line for line in record["missing"])
