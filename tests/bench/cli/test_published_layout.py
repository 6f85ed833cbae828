"""A model's views in the layouts of public codes: read back, they score as the model does, but for 8 bits."""

import json
import math
from pathlib import Path

import pytest

from radiogs_baselines.outputs.codes import CODES
from radiogs_bench.cli.main import main
from radiogs_datasets.image_files import read_image

LAYOUTS = [code for code in CODES if code != "plain"]
ON_BLACK = [code for code in LAYOUTS if code != "tensoir"]
COMPARED = ("nvs/psnr", "albedo/psnr", "relight/psnr", "normal/mae", "roughness/mse")
SCENE = ("convex", "--long-side", "48")
ROUNDING = 1 / (12 * 255**2)
"""Mean square of the error of 8 bits, in units of the stored values."""

SLOPE = {"nvs/psnr": 1.0, "relight/psnr": 1.0, "albedo/psnr": 3.4}
"""Ratio of compared to stored errors: albedo is stored linear and compared as sRGB, 3.4 times as steep at .03."""

CORRELATION = {"nvs/psnr": 0.05, "relight/psnr": 0.05, "albedo/psnr": 0.15}
"""Largest correlation of rounding with the view's error: pixels of one material have nearly one albedo."""


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("trained")
    given = [*SCENE, "--preset", "smoke", "--method", "irgs", "--out", str(out), "--no-score"]
    assert main(["train", *given]) == 0
    return out


def metrics(place: Path, record: Path, *options: str) -> dict[str, float]:
    assert main(["score", str(place), "--out", str(record), *options]) == 0
    (scores,) = json.loads(record.read_text())["protocols"].values()
    return {name: each["value"] for name, each in scores["metrics"].items() if each["value"] is not None}


def exported(trained: Path, folder: Path, code: str, bits: int, protocol: str = "default") -> dict[str, float]:
    options = ["--layout-of", code, "--bits", str(bits), "--protocol", protocol, "--file", str(folder / code)]
    assert main(["export", str(trained), *options]) == 0
    scene = ["--scene", *SCENE, "--from", code, "--protocol", protocol]
    return metrics(folder / code, folder / "score.json", *scene)


@pytest.fixture(scope="module")
def ended(trained: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, float]:
    return metrics(trained, tmp_path_factory.mktemp("model") / "score.json")


@pytest.mark.parametrize(
    "code", [*ON_BLACK[:2], *(pytest.param(code, marks=pytest.mark.slow) for code in ON_BLACK[2:])]
)
def test_with_16_bits_a_layout_on_black_scores_as_the_model_to_the_last_digit(
    code: str, trained: Path, ended: dict[str, float], tmp_path: Path
) -> None:
    found = exported(trained, tmp_path, code, 16)
    for name in COMPARED:
        assert found[name] == pytest.approx(ended[name], abs=5e-4), name


@pytest.mark.slow
def test_8_bits_change_scores_by_their_rounding_error(trained: Path, ended: dict[str, float], tmp_path: Path) -> None:
    found = exported(trained, tmp_path, "gs-ir", 8)
    for name, slope in SLOPE.items():
        share = slope**2 * ROUNDING / 10 ** (-ended[name] / 10)
        most = 10 * math.log10(1 + share + CORRELATION[name] * math.sqrt(share))
        assert abs(found[name] - ended[name]) < most, name
    assert found["normal/mae"] == pytest.approx(ended["normal/mae"], abs=0.02)
    most = ROUNDING + 0.05 * math.sqrt(ended["roughness/mse"] * ROUNDING)
    assert abs(found["roughness/mse"] - ended["roughness/mse"]) < most


@pytest.mark.slow
def test_a_layout_on_white_scores_new_views_as_a_protocol_on_white_does(trained: Path, tmp_path: Path) -> None:
    """Relit views and materials do not: they are compared where the prediction is solid, which no file states."""
    found = exported(trained, tmp_path, "tensoir", 16, "tensoir")
    whole = metrics(trained, tmp_path / "model.json", "--protocol", "tensoir")
    assert found["nvs/psnr"] == pytest.approx(whole["nvs/psnr"], abs=5e-4)


@pytest.mark.slow
def test_files_have_the_bits_that_were_asked_for(trained: Path, tmp_path: Path) -> None:
    for bits, levels in ((8, 255), (16, 65535)):
        assert main(["export", str(trained), "--layout-of", "r3dg", "--bits", str(bits), "--file", str(tmp_path)]) == 0
        values = read_image(next((tmp_path / "eval" / "render").glob("*.png"))) * levels
        assert abs(values - values.round()).max() < 1e-2
        assert bits == 8 or abs(values / 257 - (values / 257).round()).max() > 0.2, "more than 8 bits are used"


def test_an_unknown_layout_is_refused_with_the_known_ones(trained: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(trained), "--layout-of", "plain"]) == 2
    assert "`render` and `relight` write this layout" in capsys.readouterr().err
    assert main(["export", str(trained), "--layout-of", "gsir"]) == 2
    assert "Did you mean 'gs-ir'?" in capsys.readouterr().err
