"""The gate refuses results made by other sources than the installed ones, and cells with values changed by hand."""

import json
from pathlib import Path
from typing import Any

import pytest

from bench.fake_method import FAKE, finished_sweep
from bench.gate_files import put, sealed_by_hand
from radiogs_bench.cli import main
from radiogs_bench.runs import cell as cell_module


@pytest.fixture
def finished(fake: None, tmp_path: Path) -> Path:
    """A run of one seed, of one test alone."""
    return finished_sweep(tmp_path / "run")


CHANGES: dict[str, tuple[str, Any]] = {
    "metrics are null": ("metrics", None),
    "metrics are a list": ("metrics", []),
    "metrics are a number": ("metrics", 3),
    "a metric is a number": ("metrics", {"nvs/psnr": 3.0}),
    "a value in words": ("metrics", {"nvs/psnr": {"value": "3", "reason": None, "views": []}}),
    "a metric without a value": ("metrics", {"nvs/psnr": {"reason": None, "views": []}}),
    "a value above its views": ("metrics", {"nvs/psnr": {"value": 3.6, "reason": None, "views": [3.0, 4.0]}}),
    "a value below its views": ("metrics", {"nvs/psnr": {"value": 2.7, "reason": None, "views": [3.0, None]}}),
    "work in a list": ("work", []),
    "work in words": ("work", {"invert": {"steps": "6"}}),
    "seconds are null": ("seconds", None),
    "seconds in words": ("seconds", {"invert": "6"}),
    "sessions in a list": ("sessions", []),
    "a session without a machine": ("sessions", {"invert": [{"versions": {}}]}),
    "a trail that is null": ("trail", None),
    "a loss in words": (
        "trail",
        {"invert": [{"iteration": 1, "seconds": 1.0, "losses": {"distance": "1"}, "metrics": {}}]},
    ),
    "a first step without gradients": ("first_steps", {"invert": [{"iteration": 1, "losses": {}}]}),
    "stages in words": ("stages", ["invert"]),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_cell_that_was_changed_and_sealed_again_is_an_error_and_no_traceback(
    change: str, finished: Path, baseline: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell = sorted((finished / "cells").glob("*.json"))[0]
    part, value = CHANGES[change]
    sealed_by_hand(cell, put(value, part))
    for further in ([], ["--update"]):
        assert main(["gate", str(finished), "--baseline", str(baseline), *further]) == 3
        said = capsys.readouterr().err
        assert f"{cell.name} is not as it was stored: " in said
        assert part in said
    assert cell.exists()


def test_a_run_without_cells_is_an_error(finished: Path, baseline: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sealed_by_hand(finished / "sweep.json", put([], "cells"))
    for further in ([], ["--update"]):
        assert main(["gate", str(finished), "--baseline", str(baseline), *further]) == 3
        assert "the run has no cells" in capsys.readouterr().err


def test_results_of_other_sources_than_the_installed_ones_are_refused(
    finished: Path, baseline: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Audit A3: after the method was edited, and before it was run again, the gate passed."""
    monkeypatch.setattr(FAKE, "sources", (*FAKE.sources, "radiogs_core.scene.placed_light"))
    for further in ([], ["--update"]):
        assert main(["gate", str(finished), "--baseline", str(baseline), *further]) == 3
        said = capsys.readouterr().err
        assert "5 of 5 results were made by other sources than the installed ones (the method: " in said
        assert "Run the same command again" in said


def test_a_machine_with_other_weights_of_lpips_has_the_same_sources(
    finished: Path, baseline: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = bool(cell_module.missing_weights("alex"))
    monkeypatch.setattr(cell_module, "missing_weights", lambda net: "" if there else "none")
    assert main(["gate", str(finished), "--baseline", str(baseline)]) == 0


def test_results_of_a_method_that_is_not_installed_are_compared_with_a_warning(
    finished: Path, baseline: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for cell in (finished / "cells").glob("*.json"):
        assert json.loads(cell.read_text())["cell"]["method"] == FAKE.name
    monkeypatch.setattr("radiogs_bench.installed_methods.substitutes", {})
    monkeypatch.setattr("radiogs_bench.methods.offered_methods", lambda: {})
    monkeypatch.setattr("radiogs_bench.methods.substitutes", {})
    assert main(["gate", str(finished), "--baseline", str(baseline)]) == 0
    assert "warning: the run: not compared with the installed sources, because " in capsys.readouterr().out
