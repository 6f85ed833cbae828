"""Kernels are compiled before anything is timed: those of probes, too, where a cell is probed."""

import dataclasses

import pytest
import torch

from radiogs.budget import budget
from radiogs.stages import Initialisation, InverseRendering
from radiogs.variant import Variant
from radiogs_bench.experiments.method import Method
from radiogs_bench.training.warm_up import compile_kernels
from radiogs_core.kernels.rasterize.rasterize_source import blend_kernels
from scenes import sphere_scene

CPU = torch.device("cpu")
METHOD = Method(Initialisation, InverseRendering)
LITTLE = dataclasses.replace(budget("smoke"), initialise_iterations=12, inverse_iterations=9, initial_surfels=100)


@pytest.mark.parametrize("effects", ["all", "auto"])
def test_a_training_compiles_nothing_that_warming_up_has_not(effects: str) -> None:
    """Blending is compiled for its number of channels; a probe blends as many images as there are plans to compare."""
    scene, variant = sphere_scene(views=12, size=24), Variant(effects=effects)
    blend_kernels.cache_clear()
    compile_kernels(METHOD, scene, CPU, [variant])
    compiled = blend_kernels.cache_info().currsize
    first = Initialisation(scene, variant, LITTLE, 0, CPU)
    while first.iteration < first.iterations:
        first.step()
    second = InverseRendering(scene, variant, LITTLE, 0, CPU, first.state())
    while second.iteration < second.iterations:
        second.step()
    assert bool(second.model.evidence) == (effects == "auto")
    assert blend_kernels.cache_info().currsize == compiled
