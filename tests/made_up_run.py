"""A made-up run, for tests of the reports: its summary, and the arrays of its cells."""

import html
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from radiogs_reports.analyses import reports_of
from radiogs_reports.page.assemble import page, write_page
from radiogs_reports.page.pictures import Album
from radiogs_reports.run_folder import texts
from radiogs_reports.summary import (
    SCHEMA,
    CellSummary,
    Interval,
    PaperColumn,
    PaperTable,
    PaperValue,
    RunSummary,
    Summary,
    Verdict,
    seal_of,
)
from radiogs_reports.write.latex import as_formula
from radiogs_reports.write.markdown import table_line, without_markup

EMPTY = ("metrics", "seconds", "work", "guards", "losses", "trail", "made_from", "sessions")
"""Keys that are empty for an unfinished cell."""

LIGHTS = ("sky", "night")
"""Lights under which a relit view is kept."""

KEPT_CHANNELS = {"image": 3, "albedo": 3, "normal": 3, "roughness": 1, "depth": 1}
"""Maps that are kept of further views."""

CHANNELS = {"image": 3, "albedo": 3, "normal": 3, "roughness": 1, "indirect": 3, "relit": 3}


def interval(difference: float, verdict: Verdict | None = None) -> Interval:
    """A difference over two seeds of one scene."""
    return {
        "mean": difference, "low": difference - 0.5, "high": difference + 0.5, "over": "seeds", "units": 2,
        "p_value": 0.3 if verdict is None else 0.01, "verdict": verdict, "smallest": 0.2,
        "spread": {"seeds": 0.1},
    }  # fmt: skip


def cell(
    mean: float | None,
    difference: float | None = None,
    reason: str | None = None,
    rank: int | None = None,
    verdict: Verdict | None = None,
) -> CellSummary:
    between = None if difference is None else interval(difference, verdict)
    return {"mean": mean, "count": 2, "difference": between, "reason": reason, "rank": rank}


def paper_table() -> PaperTable:
    """A table of the paper with two measured rows, ties, reasons, a remark, and a column without direction."""
    columns: list[PaperColumn] = [
        {
            "key": "nvs/psnr",
            "group": "NVS",
            "label": "PSNR",
            "unit": "dB",
            "direction": "up",
            "decimals": 3,
            "smallest": 0.25,
        },
        {"key": "nvs/lpips", "group": "NVS", "label": "LPIPS", "unit": "", "direction": "down", "decimals": 4},
        {"key": "training/hours", "group": "Training", "label": "", "unit": "h", "direction": "down", "decimals": 1},
        {
            "key": "relight/samples",
            "group": "Relight",
            "label": "N",
            "unit": "rays",
            "direction": "none",
            "decimals": 0,
        },
    ]

    def value(
        mean: float | None,
        published: str | None,
        difference: float | None = None,
        rank: int | None = None,
        verdict: Verdict | None = None,
    ) -> PaperValue:
        reason = None if mean is not None else "not in this store; 100 % lost & gone"
        return {
            **cell(mean, difference, reason, rank, verdict),
            "published": published,
            "absent": None if published else "The paper prints a dash.",
        }  # type: ignore[typeddict-item]

    return {
        "key": "strategies",
        "title": "Strategies & more",
        "label": "tab:ablation_rc",
        "data": "TensoIR_Ind, four scenes",
        "reference": "ours",
        "columns": columns,
        "rows": [
            {"key": "split-sum", "text": "Split-sum, λ_rad = 0", "remark": ""},
            {"key": "detach", "text": "Detach L_G^PBR", "remark": "Printed otherwise in table 3."},
            {"key": "ours", "text": "Ours_100 %", "remark": ""},
        ],
        "cells": {
            row: {column["key"]: value for column, value in zip(columns, values, strict=True)}
            for row, values in {
                "split-sum": (value(None, "36.659"), value(None, "0.0254"), value(None, "1.0"), value(None, None)),
                "detach": (
                    value(30.1234, "37.252", -1.5, rank=2, verdict="worse"),
                    value(0.25, "0.0275", 0.0, rank=1),
                    value(0.00047, "1.1", rank=1),
                    value(64, "64"),
                ),
                "ours": (
                    value(31.6234, "37.858", rank=1),
                    value(0.25, "0.0266", rank=1),
                    value(2.04, "0.5", rank=2),
                    value(64, "128"),
                ),
            }.items()
        },
    }


def trail(scale: float = 1.0) -> dict[str, Any]:
    """Trails of both stages; the second was scored four times, 1 dB better each time."""
    return {
        "initialise": [
            {"iteration": step, "seconds": 0.1 * step, "losses": {"radiance": scale / step}, "metrics": {}}
            for step in (1, 2, 4)
        ],
        "invert": [
            {
                "iteration": step,
                "seconds": 0.25 * step,
                "losses": {"radiance": scale / step, "consistency": 0.5 * scale / step},
                "metrics": {"nvs/psnr": 26.0 + place, "normal/mae": 9.0 - place},
            }
            for place, step in enumerate((1, 2, 4, 8))
        ],
    }


def run(row: str, scene: str, seed: int, key: str, metrics: dict[str, float | None]) -> RunSummary:
    """A finished cell; its first stage takes 10 s more per decibel of NVS PSNR."""
    seconds = 10 * (metrics.get("nvs/psnr") or 30.0) - 280
    return {
        "row": row,
        "scene": scene,
        "seed": seed,
        "key": key,
        "state": "finished",
        "metrics": metrics,
        "views": ["test_000", "test_004", "test_008"],
        "by_view": {
            column: [value, value + step, value - step]
            for column, value in metrics.items()
            if value is not None
            for step in (0.5 + seed,)
        },
        "stages": [{"name": "initialise", "title": "stage 1"}, {"name": "invert", "title": "stage 2"}],
        "seconds": {"initialise": seconds, "invert": 1.0, "evaluate": 2.5},
        "work": {"initialise": {"blended_pairs": 10}, "invert": {"rays": 1000 + 50 * len(row)}},
        "guards": {"invert": {"faint_surfels": 3}},
        "losses": {"invert": {"radiance": 0.125}},
        "trail": trail(),
        "effects": None,
        "surfels": 600,
        "view": "test_004",
        "light": "sky",
        "arrays": f"cells/{key}.npz",
        "made_from": {"seed": seed, "variant": {"detach": "none"}, "method_code": "0123456789"},
        "sessions": {"invert": [{"date": "2026-01-02T03:04:05+00:00", "git": {"commit": "fedcba", "dirty": False}}]},
    }


def of_another_method(made: RunSummary, stages: dict[str, str], changes: dict[str, Any]) -> RunSummary:
    """A cell of a method with these stages (titles by name), without surfels, rays, effects and L_rad.

    Each stage takes 2 s; the last is scored after 1, 2, 4 and 8 of its 8 steps, a decibel better each time.
    ``changes`` are to its budget.
    """
    names = list(stages)
    points = [
        {"iteration": step, "seconds": 0.25 * step, "losses": {"colour": 3.0 / step, "mask": 1.0 / step}, "metrics": {}}
        for step in (1, 2, 4, 8)
    ]
    scored = [
        {**point, "metrics": {"nvs/psnr": 26.0 + place, "normal/mae": 9.0 - place}}
        for place, point in enumerate(points)
    ]
    return {
        **made,
        "stages": [{"name": name, "title": title} for name, title in stages.items()],
        "seconds": {**dict.fromkeys(names, 2.0), "evaluate": 5.0},
        "work": {},
        "guards": {},
        "losses": {name: {"colour": 0.1} for name in names},
        "trail": {name: scored if name == names[-1] else points for name in names},  # type: ignore[dict-item]
        "surfels": None,
        "sessions": {},
        "made_from": {"method": "other", "variant": {"grid": 128}, "budget": {"name": "tiny", "steps": 8, **changes}},
    }


def unfinished(row: str, scene: str, seed: int, key: str) -> RunSummary:
    """A cell that is still to be run."""
    nothing: dict[str, Any] = {"effects": None, "surfels": None, "view": None, "light": None, "arrays": None}
    empty: dict[str, Any] = {name: {} for name in EMPTY}
    place = {"row": row, "scene": scene, "seed": seed, "key": key, "state": "to do", "stages": []}
    return {**place, **nothing, **empty}  # type: ignore[typeddict-item]


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
            {"key": "nvs/psnr", "label": "NVS PSNR", "unit": "dB", "direction": "up", "decimals": 2, "smallest": 1.75},
            {
                "key": "normal/mae",
                "label": "Normal MAE",
                "unit": "degrees",
                "direction": "down",
                "decimals": 2,
                "smallest": 0.4,
            },
            {"key": "nvs/lpips", "label": "NVS LPIPS", "unit": "", "direction": "down", "decimals": 3},
        ],
        "rows": [
            {"key": "ours", "latex": "Ours", "text": "Ours", "seconds": 61.2},
            {"key": "no-rad", "latex": r"$\lambda_{rad}=0$", "text": "lambda_rad = 0", "seconds": 40.0},
        ],
        "cells": {
            "ours": {
                "nvs/psnr": cell(31.234, rank=1),
                "normal/mae": cell(7.5, rank=2),
                "nvs/lpips": cell(None, reason="no_weights"),
            },
            "no-rad": {
                "nvs/psnr": cell(30.0, -1.234, rank=2, verdict="worse"),
                "normal/mae": cell(7.0, -0.5, rank=1, verdict="better"),
                "nvs/lpips": cell(None, reason="no_weights"),
            },
        },
        "published": {"ours": {"nvs/psnr": 37.86}, "no-rad": {"nvs/psnr": 35.82}},
        "published_data": "TensoIR, four scenes",
        "machine": "a CPU, 2 threads",
        "sheet": [{"row": "ours", "scene": "my_scene", "view": "test_004", "arrays": "cells/abc.npz", "light": "sky"}],
        "keys": ["abc", "def"],
        "runs": [
            run("ours", "my_scene", 0, "abc", {"nvs/psnr": 31.0, "normal/mae": 7.4, "nvs/lpips": None}),
            run("no-rad", "my_scene", 0, "def", {"nvs/psnr": 30.0, "normal/mae": 7.0, "nvs/lpips": None}),
            unfinished("ours", "my_scene", 1, "123"),
        ],
        "paper": [paper_table()],
        "conventions": {"name": "default", "psnr": {"channels": "joint"}},
    }


def write_run(folder: Path, made: Summary, size: int = 16) -> Path:
    """The folder of the run as the harness leaves it; maps have ``size`` x ``size`` pixels."""
    (folder / "summary.json").write_text(json.dumps({**made, "seal": seal_of({**made})}))
    (folder / "cells").mkdir(exist_ok=True)
    for place, cell_of in enumerate(made["runs"]):
        if cell_of["arrays"] is not None:
            np.savez(folder / cell_of["arrays"], allow_pickle=False, **arrays(place, size))
    return folder


def written_page(made: Summary, folder: Path, size: int = 16) -> Path:
    """The page of the run, in its folder."""
    return write_page(made, write_run(folder, made, size))[0]


def in_every_form(made: Summary, key: str) -> pd.DataFrame:
    """The CSV of an analysis, whose sentences and values stand in the Markdown, the LaTeX and the page as well."""
    analysis, report = next(each for each in reports_of(made) if each[0].key == key)
    written, shown = texts(made), page(made, Album())
    markdown, latex = written[f"tables/{key}.md"], written[f"tables/{key}.tex"]
    section = shown[shown.index(f'<section id="{analysis.section}"') :].partition("</section>")[0]
    assert f'<a href="#{analysis.section}">{analysis.link}</a>' in shown
    assert analysis.title in section
    assert rf"\input{{tables/{key}.tex}}" in written["report.tex"]
    assert latex.count(r"\item") == len(report.sentences)
    for sentence in report.sentences:
        assert without_markup(f"- {sentence}\n") in markdown
        assert rf"\item {as_formula(sentence)}" in latex
        assert sentence in html.unescape(section)
    for line in (line for grid in report.grids for line in grid.rows):
        assert without_markup(table_line([item.text for item in line])) in markdown
        assert " & ".join(as_formula(item.text) for item in line) in latex
        assert all(item.text in html.unescape(section) for item in line)
    return pd.read_csv(io.StringIO(written[f"tables/{key}.csv"]))


def t_interval(values: Any) -> tuple[float, float]:
    """The ends of the 95 % t interval of the mean of some values, by scipy."""
    low, high = stats.t.interval(0.95, len(values) - 1, loc=np.mean(values), scale=stats.sem(values))
    return float(low), float(high)


def arrays(seed: int, size: int = 16) -> dict[str, Any]:
    """Maps, light and codes of a cell. All share the ground truth; incident light has none. Normals have length 1.

    Codes are of the first and the last view, the maps of the one between them.
    """
    generators = {"truth": np.random.default_rng(99), "render": np.random.default_rng(seed)}
    maps = {
        f"{side}/{name}": generator.random((size, size, count), dtype=np.float32)
        for side, generator in generators.items()
        for name, count in CHANNELS.items()
    }
    maps["render/incident"] = generators["render"].random((size, size, 3), dtype=np.float32)
    for side, generator in generators.items():
        maps |= {f"{side}/relit/{light}": generator.random((size, size, 3), dtype=np.float32) for light in LIGHTS}
        maps[f"{side}/environment"] = generator.random((4, 8, 3), dtype=np.float32)
        normal = maps[f"{side}/normal"] * 2 - 1
        maps[f"{side}/normal"] = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
        maps |= {
            f"views/{view}/{side}/{name}": generator.integers(1, 256, (size, size, count), dtype=np.uint8)
            for view in (0, 2)
            for name, count in {**KEPT_CHANNELS, **{f"relit/{light}": 3 for light in LIGHTS}}.items()
        }
    return maps
