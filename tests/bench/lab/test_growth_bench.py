"""``bench growth``: what grows alone, and the laws that are fitted."""

import json
import math
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import pytest

from radiogs_bench.cli import main
from radiogs_bench.lab.steps import growth
from radiogs_bench.lab.steps.document import table_of
from radiogs_bench.lab.steps.estimates import law_of
from radiogs_bench.lab.steps.growth import Axis
from radiogs_bench.lab.steps.growth_table import growth_table, ranged, within


@pytest.mark.slow
def test_the_command_fits_what_it_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    tracing = Axis("tracing, forward", "rays", "2,000 surfels", (1 << 11, 1 << 13, 1 << 15, 1 << 17), 1.05)
    monkeypatch.setattr(growth, "SURFELS", 2000)
    monkeypatch.setattr(growth, "KERNELS", (tracing,))
    monkeypatch.setattr(growth, "STEPS", (Axis("", "views", "200 surfels", (2, 4)),))
    monkeypatch.setattr(growth, "USUAL", replace(growth.USUAL, preset="smoke", side=24, surfels=200))
    file = tmp_path / "growth.json"
    assert main(["bench", "growth", "--passes", "1", "--json", str(file)]) == 0
    record = json.loads(file.read_text())
    rays, *steps = record["rows"]
    assert [len(each) for each in rays["seconds each"]] == [5, 5, 5, 5]
    assert rays["seconds"] == [median(each) for each in rays["seconds each"]]
    law, last = rays["law"], rays["last exponent"]
    assert last["value"] == pytest.approx(math.log(rays["seconds"][-1] / rays["seconds"][-2]) / math.log(4))
    expected = law_of(rays["values"], rays["seconds each"])
    assert expected is not None
    assert law["constant"] == pytest.approx(expected.constant._asdict())
    assert law["grown"] == pytest.approx(expected.grown._asdict())
    assert law["grown"]["low"] > 0, "tracing 64 times as many rays takes longer"
    assert {"stage 1, initialisation: beginning", "stage 2, inverse rendering: step"} <= {row["title"] for row in steps}
    assert all(row["law"] is None for row in steps), "two sizes tell no law"
    assert any(row["last exponent"] is not None for row in steps)
    assert ranged(last)[:4] in capsys.readouterr().out
    (line,) = (each for each in table_of(file) if "rays, 2,048 to 131,072" in each)
    assert ranged(law["exponent"]) in line
    assert ranged(last) in line


def a_row(low: float | None) -> dict[str, Any]:
    part = {"value": 0.01, "low": None, "high": None}
    return {
        "title": "step", "grows": "views", "values": [1, 2, 4, 8], "seconds": [1.0, 1.0, 1.0, 2.0], "at most": 1.05,
        "law": {"constant": part, "grown": part, "exponent": None},
        "last exponent": {"value": 1.3, "low": low, "high": 1.6}, "last exponent of bytes": None,
    }  # fmt: skip


@pytest.mark.parametrize(("low", "expected"), [(1.0, True), (1.2, False), (None, None)])
def test_growth_above_what_is_expected_is_marked(low: float | None, expected: bool | None) -> None:
    assert within(a_row(low)) is expected
    assert within({**a_row(low), "at most": None}) is None
    assert within({**a_row(low), "last exponent": None}) is None


def test_what_hardly_grows_has_no_exponent_in_the_table() -> None:
    cells = [next(iter(column.cells)) for column in growth_table([a_row(1.2)]).columns]
    assert cells[-4:] == ["10.0 ms", "flat", "1.30 (1.20 to 1.60)", "n/a"]
