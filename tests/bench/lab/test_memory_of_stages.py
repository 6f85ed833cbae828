"""Stages let go of what later stages do not keep."""

import gc
import weakref
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
import torch

from bench.chain_method import Chain, ChainStage, Turned
from radiogs_bench.lab.rehearsal.one_row import RowRehearsal
from radiogs_bench.lab.rehearsal.phases import Phases
from radiogs_bench.lab.rehearsal.plan import Plan, RehearsedRow
from radiogs_bench.runs.cell import Work, cell_of
from radiogs_bench.runs.interruption import Interruption
from radiogs_bench.runs.progress import LogProgress
from radiogs_bench.runs.scene_checksum import checksum_now
from radiogs_bench.runs.stages import Bench, trained
from radiogs_bench.store.folder import Store
from scenes import sphere_scene

CPU = torch.device("cpu")
SCENE = sphere_scene(views=2, size=16)


class Watched(Chain):
    """A chain that looks, at every step of its second stage, whether the product of the first one is still there."""

    def __init__(self) -> None:
        super().__init__(("coarse", "fine"))
        self.left: list[bool] = []

    def stages(self, *given: Any) -> Any:
        specs = super().stages(*given)
        begin = specs[1].begin

        def begin_watched(run: Any, before: Mapping[str, Any]) -> ChainStage:
            product, stage = weakref.ref(before["value"]), begin(run, before)
            step = stage.step

            def watch() -> Mapping[str, float]:
                self.left.append(product() is not None)
                return step()

            object.__setattr__(stage, "step", watch)
            return stage

        object.__setattr__(specs[1], "begin", begin_watched)
        return specs


@pytest.fixture
def without_collector() -> Iterator[None]:
    """Only what nothing refers to is freed, as on a GPU between two collections."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


@pytest.mark.usefixtures("without_collector")
def test_a_product_is_freed_when_the_next_stage_has_begun(tmp_path: Path) -> None:
    chain = Watched()
    bench = Bench(Store(tmp_path), CPU, LogProgress(), Interruption(), lambda _: chain, checksum_now)
    trained(bench, cell_of(chain, SCENE, Work(Turned(), chain.presets["smoke"])), SCENE)
    assert chain.left == [False, False, False]


@pytest.mark.usefixtures("without_collector")
def test_a_rehearsal_frees_it_too(tmp_path: Path) -> None:
    chain = Watched()
    row = RehearsedRow("chain", chain, "chain", Turned(), chain.presets["smoke"])
    plan = Plan("chain", "smoke", [row], SCENE, "default", 1, CPU, {}, 60.0)
    RowRehearsal(plan, row, None, Store(tmp_path), Phases(CPU), set()).train()
    assert chain.left
    assert not any(chain.left)
