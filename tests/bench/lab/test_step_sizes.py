"""``bench steps``: the model, budget and surfels that a size gives a method."""

import math
from dataclasses import dataclass, field, replace

import pytest
import torch

from bench.chain_method import Chain
from radiogs_bench.lab.kernels.scenes import OVERLAP, SPREAD
from radiogs_bench.lab.steps.sizes import SIZES
from radiogs_bench.lab.steps.subject import ON_SURFACES, lay_on_surfaces, sized_budget, subject_of, surfels_over
from radiogs_bench.methods import method
from radiogs_core.contract import Run
from radiogs_core.errors import UsageError
from radiogs_core.instruments import recording
from radiogs_core.on_surfels.fit_geometry import FitGeometry
from radiogs_core.transport.tracer import SurfelTracer, gather_incident
from radiogs_datasets import load_scene

CPU = torch.device("cpu")


@dataclass(frozen=True)
class Geometry:
    steps: int = 9
    initial_surfels: int = 100
    maximum_surfels: int = 300


@dataclass(frozen=True)
class NestedBudget:
    name: str
    geometry: Geometry = field(default_factory=Geometry)
    consistency_surfels: int = 7


@dataclass(frozen=True)
class BudgetOfAField:
    name: str
    cells: int = 9
    surfels_a_step: int = 7


def chain_with(kind: type) -> Chain:
    """A method that cannot be rehearsed, with a budget of this kind."""
    chain = Chain(("fit",))
    chain.presets = {name: kind(name) for name in ("smoke", "tiny", "small")}
    chain.stages = lambda variant, budget: ()  # type: ignore[method-assign,assignment]
    return chain


def test_a_budget_that_nests_its_surfels_is_given_the_size() -> None:
    """The surfels of a step are not the size of a model."""
    chain, scene = chain_with(NestedBudget), load_scene("corner")
    subject = subject_of(chain, scene, SIZES["20k"], CPU)
    assert subject.surfels == 20_000
    assert subject.short.budget == NestedBudget("small", Geometry(9, 20_000, 20_000), 7)
    assert subject_of(chain, scene, SIZES["tiny"], CPU).surfels == 300, "the preset's largest model"
    irgs = method("irgs")
    assert subject_of(irgs, scene, SIZES["20k"], CPU).surfels == 20_000
    assert subject_of(irgs, scene, SIZES["smoke"], CPU).surfels == 400


def test_a_size_replaces_numbers_of_the_preset_that_the_method_has() -> None:
    ours, irgs = method("radiogs"), method("irgs")
    floor, long = sized_budget(ours, SIZES["floor"]), sized_budget(ours, SIZES["long"])
    assert floor.consistency_surfels == 4
    assert floor.incident_samples == ours.presets["tiny"].incident_samples
    assert (long.consistency_surfels, long.incident_samples) == (1024, 64)
    assert sized_budget(irgs, SIZES["floor"]) == irgs.presets["tiny"]


def test_a_size_that_cannot_be_set_is_refused() -> None:
    chain, scene = chain_with(BudgetOfAField), load_scene("corner")
    with pytest.raises(UsageError, match="size 20k has 20,000 surfels, which chain cannot be given") as caught:
        subject_of(chain, scene, SIZES["20k"], CPU)
    assert caught.value.remedy == "Choose sizes that are a preset's own:  --sizes tiny,small"
    assert subject_of(chain, scene, SIZES["tiny"], CPU).surfels is None
    assert subject_of(chain, scene, SIZES["smoke"], CPU).surfels is None, "for warming up"


def test_rays_meet_surfels_on_surfaces_as_often_as_trained_ones() -> None:
    """Surfels that fill the hull are met by 48 a ray."""
    scene = load_scene("corner")
    surfels = surfels_over(scene, 3000)
    assert len(surfels) == 3000
    area = float(scene.true_surfaces(0.05 * scene.extent).size.prod(-1).sum())
    covered = float(surfels.log_scale.sum(-1).exp().sum()) / math.exp(SPREAD**2)  # the mean of lognormal areas
    assert covered / area == pytest.approx(OVERLAP**2, rel=0.1)
    with recording() as found:
        gather_incident(SurfelTracer(surfels), surfels, 4, None)
    assert 3.5 < found.work["hits"] / found.work["rays"] < 7


def test_as_many_surfels_are_laid_as_the_size_asks_for_wherever_a_method_starts() -> None:
    subject = replace(subject_of(method("irgs"), load_scene("corner"), SIZES["smoke"], CPU), surfels=500)
    run = Run(subject.scene, subject.short.variant, subject.short.budget, 0, CPU)
    stage = subject.method.stages(run.variant, run.budget)[0].begin(run, {})
    assert isinstance(stage, FitGeometry)
    assert len(stage.surfels) != 500
    assert lay_on_surfaces(stage, subject) == ON_SURFACES
    assert len(stage.surfels) == 500
