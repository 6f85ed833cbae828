"""``bench growth``: what grows alone, and the exponents that are fitted."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from scipy import stats

from radiogs_bench.cli import main
from radiogs_bench.lab.steps import growth
from radiogs_bench.lab.steps.document import table_of
from radiogs_bench.lab.steps.growth import Axis
from radiogs_bench.lab.steps.growth_table import within


def test_the_command_fits_what_it_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    tracing = Axis("tracing, forward", "rays", "2,000 surfels", (1 << 13, 1 << 15, 1 << 17), 1.05)
    monkeypatch.setattr(growth, "SURFELS", 2000)
    monkeypatch.setattr(growth, "KERNELS", (tracing,))
    monkeypatch.setattr(growth, "STEPS", (Axis("", "views", "200 surfels", (2, 4)),))
    monkeypatch.setattr(growth, "USUAL", replace(growth.USUAL, preset="smoke", side=24, surfels=200))
    file = tmp_path / "growth.json"
    assert main(["bench", "growth", "--json", str(file)]) == 0
    record = json.loads(file.read_text())
    rays, *steps = record["rows"]
    line = stats.linregress(torch.tensor(rays["values"]).log(), torch.tensor(rays["seconds"]).log())
    assert rays["seconds exponent"]["value"] == pytest.approx(line.slope, rel=1e-3)
    assert 0.5 < line.slope < 1.5
    assert within(rays) is not False
    assert {"stage 1, initialisation: beginning", "stage 2, inverse rendering: step"} <= {row["title"] for row in steps}
    assert all(row["seconds exponent"]["low"] is None for row in steps), "two sizes tell no interval"
    assert f"{rays['seconds exponent']['value']:.2f}" in capsys.readouterr().out
    assert any("rays, 8,192 to 131,072" in each for each in table_of(file))


@pytest.mark.parametrize(("low", "expected"), [(1.0, True), (1.2, False)])
def test_growth_above_what_is_expected_is_marked(low: float, expected: bool) -> None:
    exponent = {"value": 1.3, "low": low, "high": 1.6}
    assert within({"seconds exponent": exponent, "at most": 1.05}) is expected
    assert within({"seconds exponent": exponent, "at most": None}) is None
