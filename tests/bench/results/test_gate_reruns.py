"""Baselines with a rerun: what one is, how a loss over seeds is judged by it, and what the gate could find."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import ttest_1samp

from bench.fake_method import finished_sweep
from bench.gate_files import baseline_of_run, put, sealed_by_hand
from radiogs_bench.cli import main
from radiogs_bench.results.baseline import gain
from radiogs_bench.results.gate import Change, compare, power_lines
from radiogs_bench.results.paired import ERROR_RATE, Paired
from radiogs_bench.runs.sweep import read_sweep
from radiogs_bench.store import provenance
from radiogs_bench.store.folder import Store
from radiogs_core.errors import DataError

OURS = "fake ours"
LOSS = -0.15


def run(folder: Path, threads: int, seeds: int = 3) -> Path:
    """A run of the fake that claims to have had so many threads."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(provenance, "workers", lambda device: threads)
        return finished_sweep(folder, seeds)


@pytest.fixture(scope="module")
def runs(fake: None, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A run, and its rerun."""
    return run(tmp_path_factory.mktemp("run"), 1), run(tmp_path_factory.mktemp("rerun"), 2)


@pytest.fixture
def baseline(runs: tuple[Path, Path], tmp_path: Path) -> dict[str, Any]:
    """A baseline with a rerun that differs by 0.1 dB in each metric."""
    content = json.loads(baseline_of_run(runs[0], tmp_path, "--rerun", str(runs[1])).read_text())
    for metrics in content["noise"]["metrics"].values():
        assert metrics["nvs/psnr"] == [0.0, 0.0, 0.0]  # the fake does not round
        metrics["nvs/psnr"] = [0.1, -0.1, 0.1]
    return content  # type: ignore[no-any-return]


def compared(folder: Path, baseline: dict[str, Any], gains: tuple[float, ...]) -> list[Change]:
    """Changes of row ours that the gate finds after its metric has gained these amounts by seed."""
    content = json.loads(json.dumps(baseline))
    content["machine"]["cpu"] = "another"  # on its own machine a training that repeats has the same metrics
    for family in ("training", "work"):
        content["noise"][family] = {}
    for seed, gained in enumerate(gains):
        content["cells"][f"{OURS} seed {seed}"]["metrics"]["nvs/psnr"] -= gained
    found = compare(Store(folder), read_sweep(folder), content)
    return [each for each in found if each.severity not in ("warning", "remark")]


@pytest.mark.parametrize(
    ("gains", "severity"),
    [
        ((0.0, 0.0, 0.0), None),
        ((-0.1, -0.05, 0.0), None),
        ((-1.0, -1.1, -1.2), "regression"),
        ((1.0, 1.1, 1.2), "better"),
        ((-1.0, 1.1, -1.2), None),
    ],
)
def test_a_loss_over_seeds_is_a_regression_and_a_gain_is_reported(
    gains: tuple[float, ...], severity: str | None, runs: tuple[Path, Path], baseline: dict[str, Any]
) -> None:
    found = compared(runs[0], baseline, gains)
    assert [(each.cell, each.severity) for each in found] == ([] if severity is None else [(OURS, severity)])
    word = {"regression": "nvs/psnr worse by 1.1 dB (higher is better)", "better": "nvs/psnr better by 1.1 dB"}
    assert all(each.what.startswith(word[each.severity]) for each in found)


@pytest.mark.parametrize(("gained", "word"), [(-0.01, "worse"), (0.01, "better"), (0.0, "")])
def test_where_training_repeats_a_metric_that_differs_is_rendered_or_scored_otherwise(
    gained: float, word: str, runs: tuple[Path, Path], baseline: dict[str, Any]
) -> None:
    """However small beside the rerun's noise: nothing has rounded otherwise."""
    baseline["cells"][f"{OURS} seed 1"]["metrics"]["nvs/psnr"] -= gained
    found = [each for each in compare(Store(runs[0]), read_sweep(runs[0]), baseline) if each.severity == "changed"]
    assert [each.cell for each in found] == [OURS] * bool(word)
    assert all(each.what.startswith(f"nvs/psnr {word} by 0.00333 dB") for each in found)


def test_the_rerun_passes(runs: tuple[Path, Path], baseline: dict[str, Any]) -> None:
    assert compared(runs[1], baseline, ()) == []


def test_a_rerun_needs_other_threads_and_the_same_run(
    runs: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    making = ["gate", str(runs[0]), "--baseline", str(tmp_path / "baseline.json"), "--update", "--rerun"]
    assert main([*making, str(runs[0])]) == 3
    assert "repeats bit for bit" in capsys.readouterr().err
    assert main([*making, str(run(tmp_path / "fewer", 2, seeds=1))]) == 3
    assert "is no rerun" in capsys.readouterr().err
    assert not (tmp_path / "baseline.json").exists()


def test_a_rerun_without_an_update_is_wrong_usage(runs: tuple[Path, Path], tmp_path: Path) -> None:
    assert main(["gate", str(runs[0]), "--baseline", str(tmp_path / "none"), "--rerun", str(runs[1])]) == 2
    assert main(["gate", "--baseline", str(tmp_path / "none")]) == 2


def test_a_baseline_that_lacks_the_noise_of_a_metric_is_refused(
    runs: tuple[Path, Path], baseline: dict[str, Any]
) -> None:
    for broken in ({}, {"nvs/psnr": []}, {"nvs/psnr": ["0.1"]}):
        baseline["noise"]["metrics"][OURS] = broken
        with pytest.raises(DataError, match="noise of nvs/psnr"):
            compare(Store(runs[0]), read_sweep(runs[0]), baseline)


@pytest.mark.parametrize("noise", [(-0.3, -0.31, -0.29), (0.3, 0.31, 0.29), (-0.3, -0.2, -0.1), (-0.3, 0.31, -0.29)])
def test_a_rerun_that_is_worse_or_better_in_every_seed_is_no_noise(
    noise: tuple[float, ...], runs: tuple[Path, Path], baseline: dict[str, Any]
) -> None:
    """By a t test with Holm's correction over five rows: a gate would be blind to losses of its size."""
    baseline["noise"]["metrics"][OURS]["nvs/psnr"] = list(noise)
    one_sided = 5 * ttest_1samp(noise, 0).pvalue < 0.01
    assert one_sided == (np.ptp(noise) < 0.05)
    if not one_sided:
        assert list(power_lines(baseline))
        compare(Store(runs[0]), read_sweep(runs[0]), baseline)
        return
    word = "worse" if noise[0] < 0 else "better"
    with pytest.raises(DataError, match=rf"rerun is {word} in nvs/psnr of {OURS} by 0.3, in 3 of 3 differences"):
        compare(Store(runs[0]), read_sweep(runs[0]), baseline)


def test_no_baseline_is_made_with_a_rerun_that_is_worse_in_every_seed(
    runs: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rerun = Path(shutil.copytree(runs[1], tmp_path / "rerun"))
    for number, cell in enumerate(sorted((rerun / "cells").glob("*.json"))):
        value = json.loads(cell.read_text())["metrics"]["nvs/psnr"]["value"] - 0.3 - 0.001 * number
        sealed_by_hand(cell, put({"value": value, "reason": None, "views": [value]}, "metrics", "nvs/psnr"))
    file = tmp_path / "baseline.json"
    assert main(["gate", str(runs[0]), "--baseline", str(file), "--update", "--rerun", str(rerun)]) == 3
    assert re.search(r"its rerun is worse in nvs/psnr of fake [\w-]+ by 0\.3", capsys.readouterr().err)
    assert not file.exists()


def test_the_power_is_printed_by_metric_in_its_unit(baseline: dict[str, Any]) -> None:
    (line,) = (each for each in power_lines(baseline) if each.startswith(f"{OURS}: "))
    assert "nvs/psnr: a mean loss of" in line
    assert "dB (higher is better), seeds: 3; a rerun differs by 0.1 dB" in line


def test_the_power_without_a_rerun_is_the_band_and_a_warning(
    runs: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["gate", "--baseline", str(baseline_of_run(runs[0], tmp_path)), "--power"]) == 0
    said = capsys.readouterr().out
    assert "warning: the baseline has no rerun" in said
    assert f"{OURS}: nvs/psnr: a loss of more than" in said


def test_a_gain_follows_the_direction_of_the_measure() -> None:
    assert gain("nvs/psnr", 30.0) == 30.0
    assert gain("normal/mae", 5.0) == -5.0
    assert gain("light/bias", 2.0) == gain("light/bias", -2.0) == -2.0
    assert gain("nvs/invented", 1.0) is None


def test_a_loss_counts_less_among_many_metrics(runs: tuple[Path, Path], baseline: dict[str, Any]) -> None:
    """Five rows have one metric each: a loss that would count alone does not among them."""
    gains = (LOSS, LOSS - 0.05, LOSS - 0.1)
    alone = Paired(gains, [0.1, -0.1, 0.1]).p_value
    assert ERROR_RATE / 5 < alone < ERROR_RATE
    assert compared(runs[0], baseline, gains) == []
