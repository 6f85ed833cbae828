"""The solver solves the rendering equation: furnaces, dark and brighter lights, and bitwise resumption."""

import math
from dataclasses import replace
from functools import partial
from unittest.mock import patch

import pytest
import torch

from radiogs.model import Model
from radiogs.settings import PRESETS, Variant
from radiogs.showing import TrainedRadioGS
from radiogs_core.contract import Run
from radiogs_core.learning.radiance_solver import RadianceSolver, RenderingEquation, SolverBudget
from radiogs_core.learning.solver_rates import SolverRates
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.surfels.surfels import Surfels, inverse_sigmoid, radiance_to_sh
from radiogs_core.transport import tracer as tracing
from radiogs_core.transport.tracer import SurfelTracer
from radiogs_datasets.furnace import furnace
from radiogs_datasets.generate.catalogue import RECIPES
from scenes import surfels_of_room, surfels_over
from short_training import through_a_file

CAMERAS = [view.camera for view in furnace("furnace-0.5").train]
DARK = EnvironmentMap(torch.zeros(4, 8, 3))


def steps(iterations: int) -> SolverBudget:
    return SolverBudget(iterations, surfels=500, samples=48)


def solved(solver: RadianceSolver) -> Surfels:
    while solver.iteration < solver.iterations:
        solver.step()
    return solver.surfels


def along_normals(surfels: Surfels) -> torch.Tensor:
    return surfel_radiance(surfels.sh, surfels.frame[..., 2])


@pytest.mark.slow
@pytest.mark.parametrize("albedo", [0.2, 0.5])
def test_a_closed_furnace_has_the_radiance_of_its_geometric_series(albedo: float) -> None:
    room = surfels_of_room(1.0, 0.3, albedo)
    emission = torch.full_like(room.centre, 0.1)
    room.sh[:, 0] = radiance_to_sh(emission)
    equation = RenderingEquation(DARK, room.albedo, emission, parts=(0, 1))
    found = along_normals(
        solved(RadianceSolver(room, equation, CAMERAS, steps(120), 0, partial(SurfelTracer, offset=0.1)))
    )
    assert float(found.mean()) == pytest.approx(0.1 / (1 - albedo), rel=0.02)


def white_ball() -> Surfels:
    ball = surfels_over(RECIPES["convex"].solids, 0.25)
    ball.albedo_logit = torch.full_like(ball.albedo_logit, inverse_sigmoid(0.8))
    return ball


def test_without_light_all_radiance_dies_out() -> None:
    ball = white_ball()
    found = along_normals(solved(RadianceSolver(ball, RenderingEquation(DARK, ball.albedo), CAMERAS, steps(80), 0)))
    assert float(found.mean()) < 0.03  # from 0.5


@pytest.mark.slow
def test_a_light_ten_times_brighter_is_solved_in_as_many_steps() -> None:
    """Steps are taken in units of the scene's radiance, so the relative error does not depend on exposure."""
    errors = []
    for radiance in (0.5, 5.0):
        ball = white_ball()
        light = EnvironmentMap(torch.full((4, 8, 3), radiance))
        found = along_normals(
            solved(RadianceSolver(ball, RenderingEquation(light, ball.albedo), CAMERAS, steps(80), 0))
        )
        # A convex body under constant light sends out albedo times it, and a little in its specular lobe.
        errors.append(float((found / radiance).mean()))
    assert errors[0] == pytest.approx(errors[1], rel=0.05)
    assert 0.8 < errors[1] < 0.9


def test_only_radiance_learns() -> None:
    ball = white_ball()
    stage = RadianceSolver(ball, RenderingEquation(DARK, ball.albedo), CAMERAS, steps(3), 0)
    found = solved(stage).parameters()
    for name, value in ball.parameters().items():
        assert torch.equal(found[name], value) == (name != "sh"), name


def test_relighting_can_be_stopped_after_any_step_of_it() -> None:
    ball = white_ball()
    cost = replace(PRESETS["smoke"], finetune_iterations=5, finetune_surfels=500, finetune_samples=48)
    model = Model(ball, torch.zeros(4, 8, 3))
    run = Run(furnace("furnace-0.5"), Variant(relighting="surfels"), cost, 0, torch.device("cpu"))
    done: list[None] = []

    def count() -> None:
        done.append(None)

    def stop() -> None:
        count()
        if len(done) == 2:
            raise InterruptedError

    trained = TrainedRadioGS(model, run)
    trained.prepare(DARK, after_step=count)
    assert len(done) == 5
    done.clear()
    with pytest.raises(InterruptedError):
        trained.prepare(DARK, after_step=stop)
    assert len(done) == 2


def rates_after(rates: SolverRates, iterations: int, done: int) -> tuple[tuple[float, float], float]:
    """Rates of degree 0 and of the rest in step ``done``, and the unit of rates, in a bright light."""
    ball, light = white_ball(), EnvironmentMap(torch.full((4, 8, 3), 2.0))
    effort = replace(steps(iterations), rates=rates)
    solver = RadianceSolver(ball, RenderingEquation(light, ball.albedo), CAMERAS, effort, 5)
    for _ in range(done - 1):
        solver.step()
    found = solver.rates()
    return (found["sh"], found["sh_rest"]), solver.unit


def test_initial_rates_are_in_units_of_the_scenes_radiance() -> None:
    rates = SolverRates(degree_0=0.4, rest_share=0.2)
    found, unit = rates_after(rates, 12, 1)
    assert unit > 1.2
    assert found == pytest.approx((0.4 * unit, 0.2 * 0.4 * unit))


def test_rates_in_the_unit_one_do_not_depend_on_the_light_and_stay_constant_if_all_of_them_is_left() -> None:
    constant = SolverRates(degree_0=0.01, unit="one", last_share=1.0)
    assert rates_after(constant, 4, 4) == ((pytest.approx(0.01), pytest.approx(0.05 * 0.01)), 1.0)
    falling = SolverRates(degree_0=0.01, unit="one", last_share=0.1)
    assert rates_after(falling, 4, 4)[0][0] < 0.5 * 0.01


def test_rays_are_traced_in_pieces_and_reflect_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    room = surfels_of_room(1.0, 0.5, 0.5)
    light = EnvironmentMap(torch.full((4, 8, 3), 2.0))
    index, along = torch.arange(len(room)), room.frame[:, None, :, 2]

    def reflected() -> torch.Tensor:
        return RadianceSolver(room, RenderingEquation(light, room.albedo), CAMERAS, steps(1), 5).reflected(index, along)

    whole = reflected()
    monkeypatch.setattr(tracing, "RAYS_AT_ONCE", 5 * 48)
    with patch.object(SurfelTracer, "incident", autospec=True, side_effect=SurfelTracer.incident) as traced:
        torch.testing.assert_close(reflected(), whole)
    assert max(len(call.args[1]) for call in traced.call_args_list) == 5


def test_it_resumes_bit_for_bit() -> None:
    ball = white_ball()
    light = EnvironmentMap(torch.rand(4, 8, 3, generator=torch.Generator().manual_seed(1)))

    def stage() -> RadianceSolver:
        return RadianceSolver(ball, RenderingEquation(light, ball.albedo), CAMERAS, steps(12), 5)

    whole = stage()
    for step in range(12):
        if step == 5:
            saved = through_a_file(whole.state())
        whole.step()
    resumed = stage()
    resumed.restore(saved)
    assert torch.equal(solved(resumed).sh, whole.surfels.sh)


def test_the_furnace_of_eight_tenths_is_not_yet_clipped_in_display_colour() -> None:
    """Its truth is 0.1 / 0.2; the views must show what is compared."""
    view = furnace("furnace-0.8").test[0]
    assert float((view.read("direct") + view.read("indirect")).max()) == pytest.approx(0.5)
    # Wall distances, in the two directions that a view from the middle can look at most.
    assert 1.0 <= float(view.read("depth").min()) / math.cos(math.pi / 4) <= 1.5
