"""Kernels are compiled before anything is timed: those of probes, too, where a cell is probed."""

import pytest
import torch

from bench.chain_method import Chain, Turned
from radiogs.method import RADIOGS
from radiogs.settings import PRESETS, Variant
from radiogs_bench.runs.preflight import compile_kernels
from radiogs_core.contract import Run
from radiogs_core.kernels.rasterize.rasterize import blend_kernels
from radiogs_core.plain_values import with_values
from scenes import sphere_scene

CPU = torch.device("cpu")
LITTLE = with_values(PRESETS["smoke"], {"geometry.steps": 12, "inverse_iterations": 9, "geometry.initial_surfels": 100})


@pytest.mark.slow
@pytest.mark.parametrize("effects", ["all", "auto"])
def test_a_training_compiles_nothing_that_warming_up_has_not(effects: str) -> None:
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
    compile_kernels(sphere_scene(views=4), CPU, [(chain, Turned()), (chain, Turned())])
    assert chain.stepped == stepped
    assert chain.begun == begun
    assert chain.closed == begun
    assert {len(run.scene.train) for run in chain.runs} <= {2}


def test_every_variant_of_every_method_is_warmed_up_once() -> None:
    """A variant may compile what the full method does not."""
    first, second = Chain(("fit",), (True,)), Chain(("fit",), (True,), name="other")
    work = [(first, Turned()), (first, Turned(weight=2.0)), (second, Turned()), (first, Turned())]
    compile_kernels(sphere_scene(views=4), CPU, work)
    assert [run.variant.weight for run in first.runs] == [1.0, 2.0]
    assert second.stepped == ["fit"]


def test_a_stage_whose_step_fails_lets_go_of_what_it_holds() -> None:
    chain = Chain(("fit",), (True,), broken="fit")
    compile_kernels(sphere_scene(views=4), CPU, [(chain, Turned())])  # its cells will say what is wrong
    assert chain.closed == ["fit"]
