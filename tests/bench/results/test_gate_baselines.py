"""The gate compares with nothing that would let a regression pass: not with holes, NaN, other scenes, other hands."""

import json
from pathlib import Path
from typing import Any

import pytest

from bench.fake_method import finished_sweep
from bench.gate_files import put, sealed_by_hand, without
from radiogs_bench.cli import main
from radiogs_bench.results.baseline import read_baseline
from radiogs_bench.results.gate import compare
from radiogs_bench.runs.sweep import read_sweep
from radiogs_bench.store.folder import Store
from radiogs_core.errors import DataError

OURS = "fake ours seed 0"


@pytest.fixture(scope="module")
def finished(fake: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of one seed."""
    return finished_sweep(tmp_path_factory.mktemp("run"))


HOLES = {
    "no cells": put({}, "cells"),
    "cells in a list": put([], "cells"),
    "cells are a word": put("all", "cells"),
    "no key cells": without("cells"),
    "no metrics": put({}, "cells", OURS, "metrics"),
    "no key metrics": without("cells", OURS, "metrics"),
    "a metric in words": put("30", "cells", OURS, "metrics", "nvs/psnr"),
    "a metric that is true": put(True, "cells", OURS, "metrics", "nvs/psnr"),
    "no work": put({}, "cells", OURS, "work"),
    "no key work": without("cells", OURS, "work"),
    "work in words": put("6", "cells", OURS, "work", "invert", "steps"),
    "no seconds": without("cells", OURS, "seconds"),
    "seconds that are null": put(None, "cells", OURS, "seconds"),
    "no checksum": put("", "cells", OURS, "checksum"),
    "no bands": put({}, "bands"),
    "no key bands": without("bands"),
    "no band of a metric": without("bands", "fake ours", "nvs/psnr"),
    "a band that is null": put(None, "bands", "fake ours", "nvs/psnr"),
    "a band below zero": put(-1.0, "bands", "fake ours", "nvs/psnr"),
    "no machine": put({}, "machine"),
    "no key machine": without("machine"),
    "no training": without("cells", OURS, "training"),
    "training in words": put({"invert/loss/distance": ["3"]}, "cells", OURS, "training"),
    "a pace in words": put("3", "cells", OURS, "pace"),
    "seconds beyond float64": put(10**400, "cells", OURS, "seconds"),
    "no reruns": without("reruns"),
    "reruns without noise": put(1, "reruns"),
    "no sessions": put({"mixed": []}, "machine"),
    "no suite": without("suite"),
}


@pytest.mark.parametrize("hole", HOLES)
def test_a_baseline_with_a_hole_is_refused_and_that_is_no_regression(
    hole: str, finished: Path, baseline: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Audit M8 and M25: parts of the baseline missing passed, or ended with exit code 1, which means regression."""
    sealed_by_hand(baseline, HOLES[hole])
    assert main(["gate", str(finished), "--baseline", str(baseline)]) == 3
    assert "--update" in capsys.readouterr().err


@pytest.mark.parametrize("place", ["metrics", "bands"])
@pytest.mark.parametrize("value", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_a_value_that_is_no_number_does_not_pass(place: str, value: str, finished: Path, baseline: Path) -> None:
    """Audit M8: ``abs(nan) > band`` is false."""
    keys = ("cells", OURS, "metrics") if place == "metrics" else ("bands", "fake ours")
    content = json.loads(baseline.read_text())
    put("VALUE", *keys, "nvs/psnr")(content)
    baseline.write_text(json.dumps(content).replace('"VALUE"', value))
    assert main(["gate", str(finished), "--baseline", str(baseline)]) == 3


@pytest.mark.parametrize("keys", [("cells", OURS, "metrics"), ("bands", "fake ours")])
def test_nan_is_refused_too_where_nothing_read_the_baseline(
    keys: tuple[str, ...], finished: Path, baseline: Path
) -> None:
    """Audit M8: a baseline that is handed over from Python."""
    content = json.loads(baseline.read_text())
    put(float("nan"), *keys, "nvs/psnr")(content)
    with pytest.raises(DataError, match="no value or no band of nvs/psnr"):
        compare(Store(finished), read_sweep(finished), content)


def test_a_baseline_that_was_edited_is_refused(finished: Path, baseline: Path) -> None:
    """Audit M6."""
    baseline.write_text(baseline.read_text().replace('"fake ours": {\n', '"fake ours": {\n', 1))
    assert read_baseline(baseline)["suite"] == "ablations"
    content = json.loads(baseline.read_text())
    content["bands"]["fake ours"]["nvs/psnr"] = 1000.0
    baseline.write_text(json.dumps(content))
    with pytest.raises(DataError, match="does not agree with its seal"):
        read_baseline(baseline)
    assert main(["gate", str(finished), "--baseline", str(baseline)]) == 3


def test_a_baseline_of_the_version_without_seals_is_refused(finished: Path, baseline: Path) -> None:
    content = json.loads(baseline.read_text()) | {"schema": "radiogs-bench/baseline/1"}
    del content["seal"]
    baseline.write_text(json.dumps(content))
    with pytest.raises(DataError, match="no baseline of this version"):
        read_baseline(baseline)


def test_other_scene_files_are_not_compared(finished: Path, baseline: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Audit M8."""
    sealed_by_hand(baseline, put("1" * 64, "cells", OURS, "checksum"))
    assert main(["gate", str(finished), "--baseline", str(baseline)]) == 3
    assert f"other scene files than the baseline's: {OURS}" in capsys.readouterr().err


def test_cells_that_the_baseline_lacks_are_a_warning(
    finished: Path, baseline: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Audit M8: a partial baseline. A stage without counters in it is a change, a metric or a cell a warning."""

    def partial(content: dict[str, Any]) -> None:
        cells = content["cells"]
        del cells[OURS]["work"]["invert"]
        cells[OURS]["metrics"] = {"other/psnr": 1.0}
        content["bands"]["fake ours"]["other/psnr"] = 1.0
        del cells["fake nvs-init seed 0"]

    sealed_by_hand(baseline, partial)
    assert main(["gate", str(finished), "--baseline", str(baseline)]) == 1
    said = capsys.readouterr().out
    assert "changed: fake ours: stage invert: more work, steps: 0 -> 6 (new)" in said
    assert "warning: fake ours: not in the baseline: nvs/psnr" in said
    assert "warning: fake nvs-init seed 0: is not in the baseline" in said


def test_a_folder_that_cannot_be_read_is_no_regression(tmp_path: Path, finished: Path) -> None:
    """Audit M24 and M25."""
    (tmp_path / "folder").mkdir()
    assert main(["gate", str(finished), "--baseline", str(tmp_path / "folder")]) == 6
    assert main(["gate", str(finished), "--baseline", str(tmp_path / "nothing")]) == 3
