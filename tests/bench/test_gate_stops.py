"""The gate with the real method: an unchanged tree passes, one changed line of the method that matters does not."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from radiogs_bench.cli import main

METHOD = Path(__file__).parents[2] / "method"

SUITE = """
name = "two-rows"
title = "RadioGS with and without radiometric consistency"
reference = "ours"
scenes = ["corner"]
columns = ["nvs/psnr", "indirect/psnr", "albedo/psnr"]

[[rows]]
key = "ours"
text = "Ours"

[[rows]]
key = "no-rad"
text = "without L_rad"
variant = { radiometric_weight = 0.0 }
"""

REPETITIONS = 3

CHANGES = {
    "half of N_s": (
        "radiogs/settings.py",
        "        consistency_surfels=64,\n        incident_samples=8,\n",
        "        consistency_surfels=64,\n        incident_samples=4,\n",
    ),
    "V is one where the light is hidden": (
        "radiogs_core/transport/tracer.py",
        "visibility = hits.transmittance.masked_fill(solid, 0.0)",
        "visibility = (1 - hits.transmittance).masked_fill(solid, 1.0)",
    ),
    "L_rad towards the camera alone": (
        "radiogs_core/kernels/shade/shade.inl",
        "unit(any_side[0], any_side[1], any_side[2], wo_of_view + 3);",
        "for (int i = 0; i < 3; ++i) wo_of_view[3 + i] = zero;",
    ),
}


def run(method: Path, folder: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """The program with another copy of the method."""
    found_first = os.pathsep.join([str(method), *sys.path])
    command = [sys.executable, "-m", "radiogs_bench", *arguments]
    environment = os.environ | {"PYTHONPATH": found_first}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def gate(method: Path, folder: Path, *further: str) -> "subprocess.CompletedProcess[str]":
    """Run the suite of two rows with a method, from the beginning, and compare it with the baseline."""
    out = f"results_of_{method.name}"
    (folder / "suite.toml").write_text(SUITE)
    done = run(method, folder, "run", "suite.toml", "--preset", "smoke", "--threads", "1", "--out", out)
    assert done.returncode == 0, done.stderr
    return run(method, folder, "gate", out, "--baseline", "baseline.json", *further)


def test_every_change_applies() -> None:
    for what, (file, before, after) in CHANGES.items():
        assert (METHOD / file).read_text().count(before) == 1, what
        assert before != after


@pytest.mark.slow
def test_an_unchanged_tree_passes_every_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each time trained anew, in a folder of its own."""
    (tmp_path / "suite.toml").write_text(SUITE)
    baseline = ["--baseline", str(tmp_path / "baseline.json")]
    for repetition in range(1 + REPETITIONS):
        out = str(tmp_path / f"out{repetition}")
        assert main(["run", str(tmp_path / "suite.toml"), "--preset", "smoke", "--threads", "1", "--out", out]) == 0
        said = capsys.readouterr()
        assert said.err.count(": done in ") == 2
        assert main(["gate", out, *baseline, *(["--update"] if repetition == 0 else [])]) == 0, repetition
        said = capsys.readouterr()
        assert "regression:" not in said.out
        assert repetition == 0 or "2 cells: as in the baseline" in said.out


@pytest.mark.slow
def test_an_unchanged_tree_passes_and_every_change_that_matters_is_stopped(tmp_path: Path) -> None:
    assert gate(METHOD, tmp_path, "--update").returncode == 0
    copy = tmp_path / "copy"
    shutil.copytree(METHOD, copy)
    again = gate(copy, tmp_path)
    assert again.returncode == 0, again.stdout
    for what, (file, before, after) in CHANGES.items():
        changed = tmp_path / what.replace(" ", "_")
        shutil.copytree(METHOD, changed)
        (changed / file).write_text((changed / file).read_text().replace(before, after))
        stopped = gate(changed, tmp_path)
        assert stopped.returncode == 1, f"{what}: {stopped.stdout}{stopped.stderr}"
        assert "regression: corner ours seed 0: " in stopped.stdout, what
