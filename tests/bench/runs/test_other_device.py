"""Every method, trained and scored on a device that is not the host: nothing of the one meets the other."""

import math
from contextlib import nullcontext
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest
import torch

from cards import ON_CARD
from elsewhere import elsewhere, registered
from radiogs_bench.methods import method
from radiogs_bench.runs.cell import Cell, Work, cell_of
from radiogs_bench.runs.interruption import Interruption
from radiogs_bench.runs.progress import LogProgress
from radiogs_bench.runs.scene_checksum import checksum_now
from radiogs_bench.runs.stages import Bench
from radiogs_bench.runs.train import train_and_score
from radiogs_bench.store.folder import Store
from radiogs_bench.suites.baselines import PUBLISHED_METHODS
from scenes import sphere_scene

METHODS = ("radiogs", *sorted({row.method for row in PUBLISHED_METHODS}))
QUICK = ("radiogs", "irgs", "tensoir")
"""The others share their kernels with the first two."""

STEPS = 4
PLAIN = sphere_scene(views=3, size=16)
SEEN = PLAIN.test[0]
SCENE = replace(PLAIN, test=(replace(SEEN, sources={**SEEN.sources, "relit/white": SEEN.sources["image"]}),))


def shortened(budget: Any) -> Any:
    """A budget of few steps."""
    return replace(budget, **{each.name: STEPS for each in fields(budget) if each.name.endswith("iterations")})


def bench_of(name: str, folder: Path, device: torch.device) -> Bench:
    return Bench(
        Store(folder), device, LogProgress(), Interruption(), lambda _: method(name), checksum_now,
        checkpoint_seconds=0.0, checkpoint_share=math.inf,
    )  # fmt: skip


def short_cell(name: str) -> Cell:
    used = method(name)
    return cell_of(used, SCENE, Work(used.variant(), shortened(used.presets["smoke"]), 0))


@pytest.mark.parametrize("place", ["elsewhere", pytest.param("cuda", marks=ON_CARD)])
@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in METHODS]
)
def test_a_method_is_trained_and_scored(name: str, place: str, tmp_path: Path) -> None:
    on_card = place == "cuda"
    bench = bench_of(name, tmp_path, torch.device("cuda") if on_card else registered())
    cell = short_cell(name)
    with nullcontext() if on_card else elsewhere():
        train_and_score(bench, cell, SCENE)
    result = bench.store.result(cell.key)
    for metric in ("nvs/psnr", "relight/psnr", "environment/error"):
        value = result["metrics"][metric]["value"]
        assert value is not None, (metric, result["metrics"][metric]["reason"])
        assert math.isfinite(value)
