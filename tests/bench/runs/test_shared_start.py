"""Kernels are compiled before anything is timed; the start of a stage is made once for cells that agree in it."""

import gc
import time
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from bench.chain_method import SOURCES, Chain, ChainStage, ChainTrained, Steps, Turned
from radiogs.method import RADIOGS
from radiogs.settings import PRESETS, Variant
from radiogs_bench.errors import Interrupted
from radiogs_bench.runs.cell import Cell, Work, cell_of
from radiogs_bench.runs.interruption import Interruption
from radiogs_bench.runs.preflight import compile_kernels
from radiogs_bench.runs.progress import LogProgress
from radiogs_bench.runs.scene_checksum import checksum_now
from radiogs_bench.runs.stages import Bench, trained
from radiogs_bench.store.claim import Claimed
from radiogs_bench.store.folder import Store, product_name
from radiogs_core.contract import Run, SharedStart, StageSpec
from radiogs_core.instruments import count
from radiogs_core.kernels.rasterize.rasterize import blend_kernels
from radiogs_core.plain_values import with_values
from scenes import sphere_scene

CPU = torch.device("cpu")
SCENE = sphere_scene(views=2, size=16)


class Starting(Chain):
    """A chain whose last stage begins with a random start that no field of the variant decides."""

    def __init__(self) -> None:
        super().__init__(("coarse", "fine"), (True, True))
        self.made, self.takes = 0, 0.0
        self.first: weakref.ref[torch.Tensor] | None = None
        self.left: list[bool] = []

    def stages(self, variant: Turned, budget: Steps) -> Sequence[StageSpec]:
        coarse, fine = super().stages(variant, budget)
        alike = replace(coarse, reads={}, begin=self.coarse)
        return alike, replace(fine, begin=self.whole, start=SharedStart({}, SOURCES, self.make, self.begin))

    def coarse(self, run: Run, before: Mapping[str, Any]) -> ChainStage:
        return ChainStage(self, 0, replace(run, variant=Turned()), before)

    def whole(self, run: Run, before: Mapping[str, Any]) -> ChainStage:
        return self.begin(run, self.make(run, before))

    def make(self, run: Run, before: Mapping[str, Any]) -> dict[str, Any]:
        self.made += 1
        self.first = weakref.ref(before["value"])
        generator = torch.Generator().manual_seed(run.seed)
        count(searched=7)
        time.sleep(self.takes)
        value = before["value"] + torch.rand(1, generator=generator)
        return {"value": value, "generator": generator.get_state()}

    def begin(self, run: Run, made: Mapping[str, Any]) -> ChainStage:
        stage = ChainStage(self, 1, run, made)
        stage.generator.set_state(made["generator"])
        return stage


def cell(chain: Chain, weight: float = 1.0, seed: int = 0) -> Cell:
    return cell_of(chain, SCENE, Work(Turned(weight), chain.presets["smoke"], seed))


def bench_of(chain: Chain, folder: Path, stopping: bool = False) -> Bench:
    interruption = Interruption()
    interruption.requested = stopping
    return Bench(Store(folder), CPU, LogProgress(), interruption, lambda _: chain, checksum_now, checkpoint_seconds=0.0)


def value_of(model: object) -> float:
    assert isinstance(model, ChainTrained)
    return float(model.value)


def by_hand(chain: Chain, weight: float) -> float:
    """The chain without a store: every stage begun as a whole."""
    product: Mapping[str, Any] = {}
    for spec in chain.stages(Turned(weight), chain.presets["smoke"]):
        stage = spec.begin(Run(SCENE, Turned(weight), chain.presets["smoke"], 0, CPU), product)
        while stage.iteration < stage.iterations:
            stage.step()
        product = stage.product()
    return float(product["value"])


def test_cells_that_share_a_start_make_it_once_and_end_as_without_a_store(tmp_path: Path) -> None:
    chain = Starting()
    bench = bench_of(chain, tmp_path)
    ended = {weight: trained(bench, cell(chain, weight), SCENE) for weight in (1.0, 2.0)}
    assert chain.made == 1
    assert {weight: value_of(model) for weight, (model, _) in ended.items()} == {
        weight: by_hand(Starting(), weight) for weight in ended
    }


def test_its_cost_counts_for_every_cell(tmp_path: Path) -> None:
    chain = Starting()
    chain.takes = 0.3
    bench = bench_of(chain, tmp_path)
    fine = [trained(bench, cell(chain, weight), SCENE)[1]["fine"] for weight in (1.0, 2.0)]
    start = bench.store.tensors(product_name(str(cell(chain).stages[1].start)), CPU)
    for ledger in fine:
        assert ledger["work"] == {"searched": 7, "steps": 3}
        assert ledger["seconds"] > start["ledger"]["seconds"] > 0
        assert ledger["trail"][0]["seconds"] > start["ledger"]["seconds"]
        assert ledger["sessions"][0] == start["ledger"]["sessions"][0]


def test_stopping_anywhere_gives_the_same_and_makes_the_start_once(tmp_path: Path) -> None:
    chain, stops = Starting(), 0
    while True:
        try:
            model, ledgers = trained(bench_of(chain, tmp_path, stopping=stops < 7), cell(chain), SCENE)
            break
        except Interrupted:
            stops += 1
    assert stops == 7  # after two steps of each stage and after storing it, and after storing the start
    assert chain.made == 1
    assert value_of(model) == by_hand(Starting(), 1.0)
    assert ledgers["fine"]["work"] == {"searched": 7, "steps": 3}


def test_a_start_that_another_process_makes_is_left_to_it(tmp_path: Path) -> None:
    chain = Starting()
    bench = bench_of(chain, tmp_path)
    with bench.store.claim(f"stages-{cell(chain).stages[1].start}"), pytest.raises(Claimed):
        trained(bench, cell(chain), SCENE)
    assert chain.made == 0


def test_the_product_before_a_start_is_freed_when_it_is_made(tmp_path: Path) -> None:
    chain = Starting()
    step = ChainStage.step

    def watched(stage: ChainStage) -> Mapping[str, float]:
        if chain.first is not None:
            chain.left.append(chain.first() is not None)
        return step(stage)

    gc.collect()
    gc.disable()
    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(ChainStage, "step", watched)
            trained(bench_of(chain, tmp_path), cell(chain), SCENE)
    finally:
        gc.enable()
    assert chain.left == [False, False, False]


def test_the_key_of_a_start_covers_its_reads_and_the_stage_before(tmp_path: Path) -> None:
    chain = Starting()
    whole, other = cell(chain).stages[1], cell(chain, weight=2.0).stages[1]
    assert (whole.start == other.start, whole.key == other.key) == (True, False)
    assert cell(chain, seed=1).stages[1].start != whole.start

    class Changed(Starting):
        """Another start or another first stage."""

        def __init__(self, place: int, **changes: Any) -> None:
            super().__init__()
            self.place, self.changes = place, changes

        def stages(self, variant: Turned, budget: Steps) -> Sequence[StageSpec]:
            coarse, fine = super().stages(variant, budget)
            if self.place == 0:
                return replace(coarse, **self.changes), fine
            assert fine.start is not None
            return coarse, replace(fine, start=replace(fine.start, **self.changes))

    for place, changes in [
        (0, {"reads": {"a": 1}}),
        (1, {"reads": {"a": 1}}),
        (1, {"sources": ("radiogs_core.scene.placed_light",)}),
    ]:
        changed = cell(Changed(place, **changes)).stages[1]
        assert changed.start != whole.start
        assert changed.key != whole.key


LITTLE = with_values(PRESETS["smoke"], {"geometry.steps": 12, "inverse_iterations": 9, "geometry.initial_surfels": 100})


@pytest.mark.slow
@pytest.mark.parametrize("effects", ["all", "auto"])
def test_training_compiles_no_kernel_that_warming_up_has_not(effects: str) -> None:
    """Blending is compiled for its number of channels; a probe blends as many images as there are plans to compare."""
    scene, variant = sphere_scene(views=12, size=24), Variant(effects=effects)
    blend_kernels.cache_clear()
    compile_kernels(scene, CPU, [(RADIOGS, variant)])
    compiled = blend_kernels.cache_info().currsize
    run, product = Run(scene, variant, LITTLE, 0, CPU), {}
    for spec in RADIOGS.stages(variant, LITTLE):
        stage = spec.begin(run, product)
        while stage.iteration < stage.iterations:
            stage.step()
        product = stage.product()
    evidence = RADIOGS.restore(run, product).facts()["effects"]["evidence"]
    assert bool(evidence) == (effects == "auto")
    assert blend_kernels.cache_info().currsize == compiled


@pytest.mark.parametrize(
    ("compiles", "stepped", "begun"),
    [
        ((True, True, True), ["one", "two", "three"], ["one", "two", "three"]),
        ((True, False, False), ["one"], ["one"]),
        ((False, True, False), ["two"], ["one", "two"]),  # the second begins from what the first hands on
        ((False, False, False), [], []),
    ],
)
def test_one_step_is_taken_of_each_stage_that_compiles_and_none_of_the_others(
    compiles: tuple[bool, ...], stepped: list[str], begun: list[str]
) -> None:
    chain = Chain(("one", "two", "three"), compiles)
    compile_kernels(sphere_scene(views=4, size=48), CPU, [(chain, Turned()), (chain, Turned())])
    assert chain.stepped == stepped
    assert chain.begun == begun
    assert chain.closed == begun
    assert {(len(run.scene.train), run.scene.train[0].camera.width) for run in chain.runs} <= {(2, 32)}


def test_every_variant_of_every_method_is_warmed_up_once() -> None:
    """A variant may compile what the full method does not."""
    first, second = Chain(("fit",), (True,)), Chain(("fit",), (True,), name="other")
    work = [(first, Turned()), (first, Turned(weight=2.0)), (second, Turned()), (first, Turned())]
    compile_kernels(sphere_scene(views=4), CPU, work)
    assert [run.variant.weight for run in first.runs] == [1.0, 2.0]
    assert second.stepped == ["fit"]


def test_variants_are_warmed_up_with_one_start_and_step_of_shared_stages() -> None:
    chain = Starting()
    compile_kernels(sphere_scene(views=4), CPU, [(chain, Turned()), (chain, Turned(weight=2.0))])
    assert (chain.made, chain.stepped) == (1, ["coarse", "fine", "fine"])


def test_a_stage_whose_step_fails_releases_its_resources() -> None:
    chain = Chain(("fit",), (True,), broken="fit")
    compile_kernels(sphere_scene(views=4), CPU, [(chain, Turned())])  # its cells will say what is wrong
    assert chain.closed == ["fit"]
