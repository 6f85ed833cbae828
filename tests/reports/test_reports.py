"""Reports from a made-up summary: complete, escaped, ranked, repeatable; the LaTeX compiles where LaTeX is."""

import csv as csv_reader
import io
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from radiogs_reports import write_reports
from radiogs_reports.latex import escape, table
from radiogs_reports.plain import csv, markdown
from radiogs_reports.ranks import ranks
from radiogs_reports.summary import SCHEMA, CellSummary, Summary, read_summary


def cell(mean: float | None, difference: float | None = None, reason: str | None = None) -> CellSummary:
    interval = None if difference is None else {"mean": difference, "low": difference - 0.5, "high": difference + 0.5}
    return {"mean": mean, "count": 2, "difference": interval, "reason": reason}  # type: ignore[typeddict-item]


def summary() -> Summary:
    return {
        "schema": SCHEMA,
        "suite": "ablations",
        "title": "Ablation & more",
        "protocol": "default",
        "preset": "tiny",
        "scenes": ["my_scene"],
        "seeds": [0, 1],
        "reference": "ours",
        "columns": [
            {"key": "nvs/psnr", "label": "NVS PSNR", "unit": "dB", "direction": "up", "decimals": 2},
            {"key": "normal/mae", "label": "Normal MAE", "unit": "degrees", "direction": "down", "decimals": 2},
            {"key": "nvs/lpips", "label": "NVS LPIPS", "unit": "", "direction": "down", "decimals": 3},
        ],
        "rows": [
            {"key": "ours", "latex": "Ours", "text": "Ours", "seconds": 61.2},
            {"key": "no-rad", "latex": r"$\lambda_{rad}=0$", "text": "lambda_rad = 0", "seconds": 40.0},
        ],
        "cells": {
            "ours": {"nvs/psnr": cell(31.234), "normal/mae": cell(7.5), "nvs/lpips": cell(None, reason="no_weights")},
            "no-rad": {
                "nvs/psnr": cell(30.0, -1.234),
                "normal/mae": cell(7.0, -0.5),
                "nvs/lpips": cell(None, reason="no_weights"),
            },
        },
        "published": {"ours": {"nvs/psnr": 37.86}, "no-rad": {"nvs/psnr": 35.82}},
        "published_data": "TensoIR, four scenes",
        "machine": "a CPU, 2 threads",
        "sheet": [{"row": "ours", "scene": "my_scene", "view": "test_004", "arrays": "cells/abc.npz", "light": "sky"}],
        "keys": ["abc", "def"],
    }


@pytest.fixture
def run(tmp_path: Path) -> Path:
    (tmp_path / "summary.json").write_text(json.dumps(summary()))
    (tmp_path / "cells").mkdir()
    generator = np.random.default_rng(0)
    channels = {"image": 3, "albedo": 3, "normal": 3, "roughness": 1, "indirect": 3, "relit": 3}
    arrays = {
        f"{side}/{name}": generator.random((16, 16, count), dtype=np.float32)
        for side in ("render", "truth")
        for name, count in channels.items()
    }
    np.savez(tmp_path / "cells" / "abc.npz", allow_pickle=False, **arrays)
    return tmp_path


def test_reports_are_rebuilt_byte_for_byte(run: Path) -> None:
    first = {path.name: path.read_bytes() for path in write_reports(run)}
    assert {path.name: path.read_bytes() for path in write_reports(run)} == first
    assert set(first) == {
        "ablations.tex", "ablations_table.tex", "ablations.md", "ablations.csv", "contact_sheet.png",
    }  # fmt: skip


def test_the_table_says_everything_that_the_summary_says() -> None:
    text = table(summary())
    assert r"\cellcolor[HTML]{FF9999}31.23~\textcolor{gray}{(37.86)}" in text
    assert r"\cellcolor[HTML]{FFD7D7}30.00" in text
    assert r"\cellcolor[HTML]{FF9999}7.00" in text
    assert r"$-1.23 \pm 0.50$" in text
    assert "n/a$^{a}$" in text
    assert r"$^{a}$ no\_weights" in text
    assert r"my\_scene" in text
    assert r"Ablation \& more" in text
    assert "abc, def" in text
    columns = {line.count("&") for line in text.splitlines() if line.endswith(r"\\")}
    assert columns == {4}
    assert text.count("{") == text.count("}")


def test_ranks_go_by_what_is_printed_and_ties_share() -> None:
    made = summary()
    made["cells"]["no-rad"]["nvs/psnr"]["mean"] = 31.2341
    assert ranks(made, made["columns"][0]) == {"ours": 1, "no-rad": 1}
    assert ranks(made, made["columns"][1]) == {"ours": 2, "no-rad": 1}
    assert ranks(made, made["columns"][2]) == {}


def test_markdown_and_csv_carry_the_same_figures() -> None:
    text = markdown(summary())
    assert "| Ours | 31.23 | 7.50 | n/a (no_weights) | 37.86 | 61 |" in text
    records = list(csv_reader.DictReader(io.StringIO(csv(summary()))))
    assert len(records) == 6
    found = next(record for record in records if record["row"] == "no-rad" and record["column"] == "nvs/psnr")
    assert float(found["difference_low"]) == pytest.approx(-1.734)
    assert found["published"] == "35.82"


def test_the_contact_sheet_is_large_enough_to_judge(run: Path) -> None:
    write_reports(run)
    with Image.open(run / "contact_sheet.png") as sheet:
        assert sheet.width > 7 * 160
        assert sheet.height > 2 * 160


def test_text_is_escaped_character_by_character() -> None:
    assert escape(r"a_b & 5% \ {x}^~") == r"a\_b \& 5\% \textbackslash{} \{x\}\textasciicircum{}\textasciitilde{}"


def test_another_schema_is_refused(tmp_path: Path) -> None:
    (tmp_path / "summary.json").write_text(json.dumps({**summary(), "schema": "radiogs-bench/summary/0"}))
    with pytest.raises(ValueError, match="summary/0"):
        read_summary(tmp_path)


def test_the_document_compiles(run: Path) -> None:
    if shutil.which("pdflatex") is None:
        pytest.skip("pdflatex is not installed (Debian: texlive-latex-extra)")
    write_reports(run)
    made = subprocess.run(
        ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "ablations.tex"],
        cwd=run, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert made.returncode == 0, made.stdout[-2000:]
    assert not re.search(r"Undefined control sequence|Overfull \\hbox", made.stdout)
