"""The example of docs/your_method.md, installed in its own environment. Its gate is walked in tests/ci."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
EXAMPLE = ROOT / "docs" / "examples" / "own_method"

SMALL = ("--long-side", "32")

Run = Callable[..., "subprocess.CompletedProcess[str]"]

SUITE = """
name = "mean-beside-radiogs"
title = "The mean image beside RadioGS"
reference = "mean"
columns = ["nvs/psnr", "albedo/psnr", "relight/psnr", "normal/mae"]

[[rows]]
key = "mean"
text = "Mean image"
method = "mean-image"

[[rows]]
key = "dim"
text = "Mean image, half the light"
method = "mean-image"
variant = { irradiance = 0.5 }

[[rows]]
key = "half"
text = "Mean image, half of the views"
method = "mean-image"
variant = { every = 2 }

[[rows]]
key = "radiogs"
text = "RadioGS without L_rad"
variant = { radiometric_weight = 0.0 }
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """``radiogs-bench`` in an environment that sees this project, and that the example was installed into by pip."""
    folder = tmp_path_factory.mktemp("own-method")
    package = shutil.copytree(EXAMPLE, folder / "own_method")
    fresh = folder / "fresh"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", fresh], check=True)
    (site,) = fresh.glob("lib/python*/site-packages")
    # The heavy packages are not installed again; the project is found where the tests find it.
    (site / "project.pth").write_text("\n".join(path for path in sys.path if Path(path).is_dir()) + "\n")
    python = fresh / "bin" / "python"
    options = ("--quiet", "--no-index", "--no-deps", "--no-build-isolation", "--disable-pip-version-check")
    subprocess.run([sys.executable, "-m", "pip", "--python", python, "install", *options, package], check=True)

    def call(*arguments: str) -> "subprocess.CompletedProcess[str]":
        environment = {**os.environ, "COLUMNS": "200"}
        return subprocess.run(
            [python, "-m", "radiogs_bench", *arguments],
            cwd=folder, env=environment, capture_output=True, text=True, check=False,
        )  # fmt: skip

    return call


@pytest.fixture(scope="module")
def out(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of both methods from a suite in a file, with preset smoke."""
    folder = tmp_path_factory.mktemp("run")
    (folder / "suite.toml").write_text(SUITE)
    done = run(
        "run", f"{folder / 'suite.toml'}", "--preset", "smoke", "--seeds", "2", *SMALL, "--out", f"{folder / 'out'}"
    )
    assert done.returncode == 0, done.stderr
    return folder / "out"


def test_the_method_is_listed_with_its_fields_and_presets(run: Run) -> None:
    listed = run("methods", "mean-image", "--json")
    assert listed.returncode == 0, listed.stderr
    said = json.loads(listed.stdout)
    assert said["variant"] == {"every": 1, "irradiance": 1.0}
    assert said["presets"]["smoke"] == {"name": "smoke", "views": 4}
    assert said["origin"] == "mean-image 0.1.0"
    assert "radiogs" in run("methods").stdout


def test_the_rows_of_a_command_stand_in_the_tables_beside_radiogs(out: Path) -> None:
    table = (out / "mean-beside-radiogs.md").read_text()
    assert "Mean image, half the light" in table
    assert "RadioGS without L" in table
    summary = json.loads((out / "summary.json").read_text())
    values = {row: cells["nvs/psnr"]["mean"] for row, cells in summary["cells"].items()}
    assert values["mean"] > 10
    # The mean is of light times albedo: how bright the light is taken to be shows in the albedo alone.
    assert values["mean"] == pytest.approx(values["dim"], abs=1e-4)
    assert values["mean"] != pytest.approx(values["half"], abs=1e-2)
    assert summary["cells"]["mean"]["normal/mae"]["mean"] is None
    assert "does not give" in summary["cells"]["mean"]["normal/mae"]["reason"]
    assert summary["cells"]["radiogs"]["normal/mae"]["mean"] is not None


def test_rows_that_its_stage_does_not_read_share_it(out: Path) -> None:
    cells = [json.loads(path.read_text())["cell"] for path in (out / "cells").glob("*.json")]
    mine = [cell for cell in cells if cell["method"] == "mean-image"]
    assert len(mine) == 6
    assert len({cell["stages"]["average"] for cell in mine}) == 4  # two a seed, for three rows
    whole = [cell for cell in mine if cell["variant"]["every"] == 1]
    assert len({cell["stages"]["average"] for cell in whole}) == 2  # one a seed, for two rows
