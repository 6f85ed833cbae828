"""The kit's geometry stage: what every surfel method begins with, whoever asks for it."""

import gc
import weakref
from dataclasses import dataclass, replace
from typing import Literal

import pytest
import torch

from radiogs.initialise import Initialisation
from radiogs.settings import Variant
from radiogs_core.contract import Run, Stage
from radiogs_core.errors import DataError
from radiogs_core.learning.geometry import GeometryLearning, GeometrySchedule, SurfelRates
from radiogs_core.learning.views import load
from radiogs_core.on_surfels.fit_geometry import FitGeometry, fit_geometry, largest_contribution, surfels_of
from radiogs_core.plain_values import with_values
from radiogs_core.surfels.density import AdaptiveDensity, OpacityResets
from radiogs_core.surfels.starting_points import SurfelStart
from short_training import BUDGET, CPU, SCENE, through_a_file

RUN = Run(SCENE, Variant(), BUDGET, 0, CPU)


def begun() -> Stage:
    return fit_geometry(GeometryLearning(), BUDGET.geometry).begin(RUN, {})


def finished(stage: Stage) -> Stage:
    while stage.iteration < stage.iterations:
        stage.step()
    return stage


def test_it_is_the_initialisation_of_radiogs_by_novel_view_synthesis_alone() -> None:
    """The rest of a variant and a budget does not reach it."""
    alone = fit_geometry(GeometryLearning(), BUDGET.geometry).begin(Run(SCENE, None, None, 0, CPU), {})
    ours = surfels_of(finished(alone).product(), CPU)
    theirs = finished(Initialisation(Run(SCENE, Variant(initialise="nvs"), BUDGET, 0, CPU))).product()
    for name, value in surfels_of(theirs, CPU).parameters().items():
        assert torch.equal(value, ours.parameters()[name]), name


def test_materials_stay_as_they_start() -> None:
    surfels = surfels_of(finished(begun()).product(), CPU)
    torch.testing.assert_close(surfels.albedo, torch.full_like(surfels.albedo, 0.5))
    torch.testing.assert_close(surfels.roughness, torch.full_like(surfels.roughness, 0.6))


def test_it_resumes_bit_for_bit_across_density_control() -> None:
    whole, resumed = begun(), begun()
    while whole.iteration < 7:
        whole.step()
    resumed.restore(through_a_file(whole.state()))
    before, after = (surfels_of(finished(stage).product(), CPU).parameters() for stage in (whole, resumed))
    assert all(torch.equal(value, after[name]) for name, value in before.items())


def test_a_stage_is_freed_as_soon_as_nothing_refers_to_it() -> None:
    """It is in no cycle, which would keep its tensors until the next collection."""
    stage = begun()
    stage.step()
    left = weakref.ref(stage)
    gc.collect()
    gc.disable()
    try:
        del stage
        assert left() is None
    finally:
        gc.enable()


def test_the_rate_of_positions_falls_geometrically_and_then_stays() -> None:
    in_the_hull = GeometryLearning(start=SurfelStart(points="hull"))
    stage = fit_geometry(in_the_hull, BUDGET.geometry).begin(RUN, {})
    assert isinstance(stage, FitGeometry)
    unit, rates, until = SCENE.extent * BUDGET.geometry.rate, SurfelRates(), GeometrySchedule().position_decay_until
    found = []
    for progress in (0.0, 0.5 * until, until, 1.0):
        stage.iteration = round(progress * stage.iterations)
        stage.begin_step()
        found.append(stage.optimiser.rates["centre"] / unit)
    half = round(0.5 * until * stage.iterations) / (until * stage.iterations)
    between = rates.position ** (1 - half) * rates.position_end**half
    assert found == pytest.approx([rates.position, between, rates.position_end, rates.position_end])


@pytest.mark.parametrize("lowered", [False, True])
def test_a_reset_of_opacities_clears_their_moments_and_no_others(lowered: bool) -> None:
    """Else the moments of before would pull opacities back up."""
    every = OpacityResets(lower_every=0.25, recovery=1) if lowered else OpacityResets()
    rules = AdaptiveDensity(start=0.0, end=1.0, hidden_at=(), resets=every)
    budget = with_values(BUDGET, {"geometry.densify_interval": 10**6})
    stage = fit_geometry(GeometryLearning(density=rules), budget.geometry).begin(RUN, {})
    assert isinstance(stage, FitGeometry)
    for _ in range(BUDGET.geometry.steps // 4):
        stage.step()
    assert (float(stage.surfels.opacity.detach().max()) < 0.0101) == lowered
    moments = stage.state()["optimiser"]["moments"]
    assert ("opacity_logit" not in moments) == lowered
    assert {"rotation", "log_scale", "sh"} <= moments.keys()


SHAPE = ("centre", "rotation", "log_scale")


@pytest.mark.parametrize(("points", "still"), [("hull", False), ("swept", True)])
def test_surfels_that_start_in_the_hull_move_from_the_first_step_on(
    points: Literal["hull", "swept"], still: bool
) -> None:
    learning = GeometryLearning(start=SurfelStart(points=points))
    stage = fit_geometry(learning, BUDGET.geometry).begin(RUN, {})
    assert isinstance(stage, FitGeometry)
    stage.begin_step()
    assert [stage.optimiser.rates[name] == 0 for name in SHAPE] == [still] * 3


def test_surfels_take_their_colours_before_they_move() -> None:
    budget = with_values(BUDGET, {"geometry.densify_interval": 10**6})
    learning = GeometryLearning(schedule=GeometrySchedule(moving_from=0.4), density=AdaptiveDensity(hidden_at=()))
    stage = fit_geometry(learning, budget.geometry).begin(RUN, {})
    assert isinstance(stage, FitGeometry)
    start = {name: value.detach().clone() for name, value in stage.optimiser.tensors.items()}

    def changed() -> set[str]:
        now = stage.optimiser.tensors
        return {name for name, value in start.items() if not torch.equal(value, now[name])}

    while stage.iteration < 0.4 * stage.iterations:
        assert not changed() & set(SHAPE)
        stage.step()
    assert {"sh", "opacity_logit"} <= changed()
    stage.step()
    assert set(SHAPE) <= changed()


def test_a_stage_that_loses_its_last_surfel_says_so() -> None:
    rules = AdaptiveDensity(start=0.0, hidden_at=(), opacity_floor=1.0)
    spec = fit_geometry(GeometryLearning(density=rules), replace(BUDGET.geometry, densify_interval=2))
    stage = spec.begin(Run(SCENE, Variant(), BUDGET, 0, CPU), {})
    stage.step()
    with pytest.raises(DataError, match="no surfel is left after step 2 of stage 1"):
        stage.step()


def test_surfels_that_show_in_no_view_do_not_outlive_the_stage() -> None:
    rules = AdaptiveDensity(hidden_at=(1.0,), least_contribution=0.5)
    surfels = surfels_of(
        finished(fit_geometry(GeometryLearning(density=rules), BUDGET.geometry).begin(RUN, {})).product(), CPU
    )
    shown = largest_contribution(surfels, load(SCENE.train, CPU))
    assert float(shown.min()) >= 0.5


@pytest.mark.slow
@pytest.mark.parametrize("colour", ["linear", "display"])
def test_it_learns_the_images_in_either_colour(colour: str) -> None:
    longer = with_values(BUDGET, {"geometry.steps": 120, "geometry.densify_interval": 20})
    spec = fit_geometry(GeometryLearning(colour=colour), longer.geometry)  # type: ignore[arg-type]
    stage = spec.begin(Run(SCENE, Variant(), longer, 0, CPU), {})
    losses = [stage.step()["radiance"] for _ in range(stage.iterations)]
    # Eight steps are every view on both backgrounds.
    assert sum(losses[-8:]) < 0.7 * sum(losses[:8])


def test_methods_that_ask_for_the_same_share_it() -> None:
    spec = fit_geometry(GeometryLearning(), BUDGET.geometry)
    assert spec.reads == fit_geometry(GeometryLearning(), BUDGET.geometry).reads
    assert spec.reads != fit_geometry(GeometryLearning(), BUDGET.geometry, view_share=0.5).reads
    assert spec.reads != fit_geometry(GeometryLearning(colour="display"), BUDGET.geometry).reads
    assert spec.owner == "radiogs_core"


@dataclass(frozen=True)
class FlatBudget:
    """A budget as plug-ins had it before ``GeometryBudget``."""

    initialise_iterations: int = BUDGET.geometry.steps
    initial_surfels: int = BUDGET.geometry.initial_surfels
    maximum_surfels: int = BUDGET.geometry.maximum_surfels
    densify_interval: int = BUDGET.geometry.densify_interval
    geometry_rate: float = BUDGET.geometry.rate


def test_a_budget_with_flat_fields_still_works_with_a_warning() -> None:
    with pytest.warns(FutureWarning, match="give fit_geometry a GeometryBudget"):
        flat = fit_geometry(GeometryLearning(), FlatBudget())
    assert flat.reads == fit_geometry(GeometryLearning(), BUDGET.geometry).reads
    assert flat.steps == BUDGET.geometry.steps
