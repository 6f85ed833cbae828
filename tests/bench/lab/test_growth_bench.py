"""``bench growth``: what grows alone, and its exponents."""

import json
from dataclasses import replace
from pathlib import Path
from statistics import median

import pytest

from radiogs_bench.cli import main
from radiogs_bench.lab.steps import growth
from radiogs_bench.lab.steps.growth import Axis, exponents
from radiogs_bench.lab.steps.record import milliseconds

ROOT = Path(__file__).parents[3]


@pytest.mark.slow
def test_the_command_prints_growth_exponents(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    tracing = Axis("tracing, forward", "rays", "2,000 surfels", (1 << 11, 1 << 13, 1 << 15, 1 << 17))
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
    assert rays["seconds"][-1] > rays["seconds"][0], "tracing 64 times as many rays takes longer"
    assert rays["exponents"] == pytest.approx(exponents(rays["values"], rays["seconds"]))
    assert {"stage 1, initialisation: beginning", "stage 2, inverse rendering: step"} <= {row["title"] for row in steps}
    assert any(row["exponents"] != [None] for row in steps)
    assert f"{rays['exponents'][-1]:.2f}" in capsys.readouterr().out


def test_exponents_equal_a_power_laws_without_an_offset() -> None:
    sizes = [750, 1500, 6000]
    assert exponents(sizes, [3e-6 * size**1.5 for size in sizes]) == pytest.approx([1.5, 1.5])
    first, last = exponents(sizes, [0.1 + 1e-4 * size for size in sizes])
    assert 0 < first < last < 1
    assert exponents(sizes, [0.0, 1.0, 2.0]) == [None, 0.5]
    assert exponents(sizes, [2.0**19, 2.0**20 + 1, 2.0**22], least=2**20) == [None, pytest.approx(1.0, abs=1e-5)]


def test_the_document_has_lines_of_the_stored_values() -> None:
    text = (ROOT / "docs" / "cost.md").read_text(encoding="utf-8")
    block = text.partition("<!-- measured growth -->")[2].partition("<!-- end of measured -->")[0]
    stored = json.loads((ROOT / "docs" / "performance" / "growth.json").read_text())
    lines = {}
    for row in stored["rows"]:
        first, *_, last = exponents(row["values"], row["seconds"])
        grows = f"{row['grows']}, {row['values'][0]:,} to {row['values'][-1]:,}"
        ends = f"{milliseconds(row['seconds'][0])} | {milliseconds(row['seconds'][-1])} | {first:.2f} | {last:.2f}"
        lines[f"| {row['title']} | {grows} | {ends} |"] = row["title"]
    shown = [line for line in block.splitlines() if line.startswith("|")][2:]
    assert set(shown) <= lines.keys()
    assert {lines[line] for line in shown} >= {
        "tracing, forward", "rasterizing, forward", "stage 1, initialisation: step", "stage 2, inverse rendering: step",
    }  # fmt: skip
    assert stored["git"]["commit"][:7] in block
