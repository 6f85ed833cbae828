"""Given parts of the truth have the true values, are frozen, and act the same in training and in rendering."""

from dataclasses import replace
from functools import partial
from typing import Any

import pytest
import torch

from radiogs.initialise import Initialisation
from radiogs.invert import InverseRendering, rates_of
from radiogs.learning import MaterialLearning, MaterialRates
from radiogs.method import RADIOGS, inverse_rendering
from radiogs.model import Model
from radiogs.oracle import (
    DARKEST,
    FROZEN,
    SPACING,
    Start,
    given_geometry,
    known_radiance,
    log_radiance,
    with_given_parts,
)
from radiogs.rays import KnownIndirectTracer, Nearest
from radiogs.relighting import RelitByRays, relight
from radiogs.settings import Variant
from radiogs.showing import TrainedRadioGS
from radiogs_bench.runs.cell import Work, cell_of
from radiogs_core.capabilities import PARTS, Part, TakesGiven, require_truth
from radiogs_core.contract import Run
from radiogs_core.errors import DataError, UsageError
from radiogs_core.learning.known_scene import known_scene
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene
from radiogs_core.surfels.known_surfaces import KnownRadiance, surfels_on
from radiogs_core.surfels.surfels import Surfels, radiance_to_sh
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_datasets.furnace import furnace
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.solids import Box, Sphere
from radiogs_datasets.generate.surfaces import surfaces_of
from scenes import surfels_facing
from short_training import BUDGET, CPU, SCENE, resumed, same_tensors, through_a_file

LEFT, RIGHT = Material((0.8, 0.1, 0.1), 0.3), Material((0.1, 0.1, 0.8), 0.9)
SOLIDS = [Sphere((-0.5, 0.0, 0.0), 0.45, LEFT), Sphere((0.5, 0.0, 0.0), 0.45, RIGHT)]
SUNNY = EnvironmentMap(torch.rand(8, 16, 3, generator=torch.Generator().manual_seed(3)) * 5)
KNOWN = replace(SCENE, surfaces=partial(surfaces_of, SOLIDS), training_light=SUNNY, surfaces_by=("radiogs_datasets",))


@pytest.fixture(scope="module")
def initialised() -> dict[str, Any]:
    stage = Initialisation(Run(KNOWN, Variant(), BUDGET, 0, CPU))
    for _ in range(stage.iterations):
        stage.step()
    return through_a_file(stage.product())


def inverse(initialised: dict[str, Any], *given: Part) -> InverseRendering:
    """Stage 2, in which a light that was searched for is learnt too; by default it is held."""
    materials = MaterialLearning(rates=MaterialRates(light=0.0005))
    return inverse_rendering(Run(KNOWN, Variant(given=given, materials=materials), BUDGET, 0, CPU), initialised)


def learnt(*positions: tuple[float, float, float], albedo: float = 0.3) -> Surfels:
    centre = torch.tensor(positions)
    surfels = surfels_facing(centre, torch.nn.functional.normalize(centre, dim=-1))
    return surfels.with_material(albedo, 0.6)


def start_of(surfels: Surfels) -> Start:
    names = [*surfels.parameters(), "sh_rest", "log_environment"]
    return Start(surfels, torch.zeros(4, 8, 3), dict.fromkeys(names, 0.01))


@pytest.mark.slow
@pytest.mark.parametrize("part", [*PARTS, None])
def test_given_parts_are_frozen_and_the_others_are_learnt(initialised: dict[str, Any], part: Part | None) -> None:
    stage = inverse(initialised, *([part] if part else []))
    before = {name: value.detach().clone() for name, value in stage.optimiser.tensors.items()}
    for _ in range(4):
        stage.step()
    frozen = set(FROZEN.get(part or "", ()))
    for name, value in stage.optimiser.tensors.items():
        assert torch.equal(value, before[name]) == (name in frozen), name


def test_surfels_on_given_surfaces_learn_scale_and_opacity_at_the_rates_of_stage_1() -> None:
    learnt_rates, given_rates = rates_of(Variant(), 2.0, 100), rates_of(Variant(given=("geometry",)), 2.0, 100)
    changed = {name for name in learnt_rates if learnt_rates[name] != given_rates[name]}
    assert changed == {"log_scale", "opacity_logit"}
    before = Variant().geometry.rates
    assert (given_rates["log_scale"], given_rates["opacity_logit"]) == (before.scale, before.opacity)
    assert not changed & set(FROZEN["geometry"])
    assert learnt_rates["centre"] == pytest.approx(2 * rates_of(Variant(), 1.0, 100)["centre"])


def test_given_geometry_is_the_true_surface_with_the_nearest_learnt_radiance() -> None:
    surfels = learnt((-1.0, 0.01, 0.0), (1.0, 0.01, 0.0))
    surfels.sh[0, 0], surfels.sh[1, 0] = 1.0, 2.0
    surfels.sh[:, 1:] = 9.0
    given = given_geometry(surfels, ("geometry",), KNOWN)
    middle = torch.tensor([0.5, 0.0, 0.0]) * given.centre[:, :1].sign()
    assert torch.allclose((given.centre - middle).norm(dim=-1), torch.tensor(0.45), atol=1e-5)
    outwards = torch.nn.functional.normalize(given.centre - middle, dim=-1)
    assert torch.allclose(given.frame[..., 2], outwards, atol=1e-4)
    assert torch.allclose(given.scale, torch.full_like(given.scale, 0.65 * SPACING * KNOWN.extent), rtol=0.02)
    ends = given.centre[:, 0].abs() > 0.7
    expected = torch.where(given.centre[:, 0] < 0, 1.0, 2.0)
    assert torch.equal(given.sh[ends, 0, 0], expected[ends])
    assert not bool(given.sh[:, 1:].any())
    assert torch.allclose(given.albedo, torch.tensor(0.3))
    assert torch.allclose(given.roughness, torch.tensor(0.6))


def test_given_light_has_its_own_resolution_and_raised_zeros(initialised: dict[str, Any]) -> None:
    stage = inverse(initialised, "light")
    stage.step()
    assert torch.allclose(stage.model.environment, SUNNY.radiance, rtol=1e-5)
    dark = SUNNY.radiance.clone()
    dark[0] = 0
    raised = log_radiance(EnvironmentMap(dark)).exp()
    assert torch.allclose(raised[0], DARKEST * dark.mean(), rtol=1e-4)
    assert torch.allclose(raised[1:], dark[1:], rtol=1e-5)
    sun = torch.zeros(64, 128, 3)
    sun[9, 9] = 1e5
    assert float(log_radiance(EnvironmentMap(sun)).exp().sum()) == pytest.approx(float(sun.sum()), rel=1e-3)
    assert bool(torch.isfinite(log_radiance(EnvironmentMap(torch.zeros(2, 4, 3)))).all())


@pytest.mark.parametrize("with_geometry", [False, True])
def test_given_materials_come_from_the_nearest_true_surface(with_geometry: bool) -> None:
    start = start_of(learnt((-1.0, 0.0, 0.0), (1.0, 0.1, 0.0), (-0.7, 0.5, 0.2)))
    given = with_given_parts(start, ("geometry", "albedo") if with_geometry else ("albedo",), KNOWN, 0).surfels
    for surface, side in ((LEFT, given.centre[:, 0] < 0), (RIGHT, given.centre[:, 0] > 0)):
        assert torch.allclose(given.albedo[side], torch.tensor(surface.albedo), atol=1e-4)
    assert torch.allclose(given.roughness, torch.tensor(0.6))  # was not given
    rough = with_given_parts(start, ("roughness",), KNOWN, 0).surfels
    assert torch.allclose(rough.roughness, torch.tensor([LEFT.roughness, RIGHT.roughness, LEFT.roughness]), atol=1e-4)
    assert torch.equal(rough.albedo, start.surfels.albedo)


def test_the_nearest_sample_at_a_crease_has_the_same_normal() -> None:
    floor, wall = (Box((-1.0, -1.0, -0.1), (1.0, 1.0, 0.0), LEFT), Box((-1.1, -1.0, -0.1), (-1.002, 1.0, 1.0), RIGHT))
    true = surfels_on(surfaces_of([floor, wall], 0.1))
    near = surfels_facing(torch.tensor([[-0.99, 0.0, 0.03]] * 2), torch.tensor([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]))
    found = true.albedo[Nearest(true, true).of(near)]
    assert torch.allclose(found, torch.tensor([LEFT.albedo, RIGHT.albedo]), atol=1e-4)


@pytest.mark.slow
def test_given_indirect_light_of_a_furnace_does_not_depend_on_the_depth_of_a_surfel() -> None:
    """In a furnace of albedo 1/2 with an emission of 0.1, a radiance of 0.2 arrives from all directions."""
    known = known_scene(furnace("furnace-0.5"), 0.25)
    true = known_radiance(known, seed=0).surfels
    sunk = surfels_facing(torch.tensor([[0.1, 0.2, -1.04], [0.0, 0.0, -0.97]]), torch.tensor([[0.0, 0.0, 1.0]] * 2))
    tracer, index = KnownIndirectTracer(sunk, true), torch.arange(2)
    incident = tracer.incident(index, *hemisphere_directions(sunk.frame[..., 2], 64, None))
    assert torch.allclose(incident.radiance, torch.tensor(0.2), rtol=0.06)
    # The model has no walls; the lower surfel sees the back of the other one.
    assert torch.equal(incident.visibility[1], torch.ones(64))
    below = tracer.incident(index, *hemisphere_directions(-sunk.frame[..., 2], 64, None))
    assert not bool(below.radiance.any())


def test_a_surfel_below_the_surface_gets_the_light_of_the_surface() -> None:
    floor, wall = Box((-1.0, -1.0, -0.1), (1.0, 1.0, 0.0), LEFT), Box((-1.1, -1.0, -0.1), (-1.002, 1.0, 1.0), RIGHT)
    true = surfels_on(surfaces_of([floor, wall], 0.1))
    true.sh[:, 0] = radiance_to_sh(true.albedo)
    up = torch.tensor([[0.0, 0.0, 1.0]])
    on, sunk = (surfels_facing(torch.tensor([[-0.7, 0.0, height]]), up) for height in (0.0, -0.03))
    direction, weight = hemisphere_directions(up, 256, None)
    index = torch.arange(1)
    lit, below = (KnownIndirectTracer(each, true).incident(index, direction, weight).radiance for each in (on, sunk))
    assert torch.equal(lit, below)
    bright = lit[0, :, 2] > 0.5  # the wall is blue
    assert 0.2 < float(bright.float().mean()) < 0.45
    assert float(lit[0, direction[0, :, 0] > 0].abs().max()) < 0.05


@pytest.mark.slow
def test_given_indirect_light_is_the_same_in_training_and_in_rendering(initialised: dict[str, Any]) -> None:
    stage = inverse(initialised, "indirect")
    model = Model.of(through_a_file(stage.product()))
    cache = stage.shader.cache.incident  # type: ignore[union-attr]
    kept = KnownIndirectTracer(model.surfels, model.indirect.surfels).incident(
        torch.arange(len(model.surfels)), cache.direction, cache.weight
    )
    assert torch.allclose(kept.radiance, cache.radiance, atol=1e-6)
    assert float(cache.radiance.sum()) > 0
    run = Run(KNOWN, Variant(given=("indirect",)), BUDGET, 0, CPU)
    mine, theirs = (TrainedRadioGS(each, run).renderer().incident for each in (model, replace(model, indirect=None)))
    assert not torch.allclose(mine.radiance, theirs.radiance, atol=1e-3)
    assert torch.equal(mine.visibility, theirs.visibility)


@pytest.mark.slow
def test_relighting_does_not_use_given_indirect_light(initialised: dict[str, Any]) -> None:
    stage = inverse(initialised, "indirect")
    run = Run(KNOWN, Variant(given=("indirect",)), BUDGET, 0, CPU)
    lit = []
    for model in (stage.model, replace(stage.model, indirect=None)):
        relit = relight(model, SUNNY, torch.ones(3), run)
        assert isinstance(relit, RelitByRays)
        lit.append(relit.incident.radiance)
    assert torch.equal(*lit)


@pytest.mark.slow
def test_a_run_with_given_indirect_light_resumes_bit_for_bit(initialised: dict[str, Any]) -> None:
    whole, again = resumed(lambda: inverse(initialised, "light", "indirect"), 3, 8)
    assert same_tensors(whole, again)


def test_the_facts_list_given_parts_and_the_residual_of_given_radiance(initialised: dict[str, Any]) -> None:
    model = inverse(initialised).model
    run = Run(KNOWN, Variant(given=("indirect", "light")), BUDGET, 0, CPU)
    given = replace(model, indirect=KnownRadiance(model.surfels, 0.25))
    assert TrainedRadioGS(given, run).facts()["given"] == {"parts": ["light", "indirect"], "indirect_residual": 0.25}
    assert "given" not in TrainedRadioGS(model, replace(run, variant=Variant())).facts()


def test_the_facts_have_the_largest_bounds_of_all_whole_plans(initialised: dict[str, Any]) -> None:
    def evidence(effect: str, bound: float | None) -> dict[str, Any]:
        return {"effect": effect, "why": "", "measured": bound and {"bound": bound, "worst": 2 * bound}}

    model, run = inverse(initialised).model, Run(KNOWN, Variant(), BUDGET, 0, CPU)
    assert TrainedRadioGS(model, run).facts()["metrics"] == {"plan/bound": 0.0, "plan/worst": 0.0}
    records = (evidence("plan", 0.1), evidence("indirect", 0.9), evidence("plan", 0.2), evidence("plan", None))
    assert TrainedRadioGS(replace(model, evidence=records), run).facts()["metrics"] == {
        "plan/bound": 0.2, "plan/worst": 0.4,
    }  # fmt: skip


def test_given_parts_and_the_sources_of_true_surfaces_change_only_the_key_of_stage_two() -> None:
    assert isinstance(RADIOGS, TakesGiven)

    def keys(scene: Scene, *parts: Part) -> list[str]:
        variant = RADIOGS.with_given(Variant(), parts)
        return [stage.key for stage in cell_of(RADIOGS, scene, Work(variant, BUDGET)).stages]

    elsewhere = replace(KNOWN, surfaces_by=("radiogs_core.errors",))
    choices = [(), *((part,) for part in PARTS), PARTS]
    found = [keys(KNOWN, *parts) for parts in choices]
    assert len({first for first, _ in found}) == 1
    assert len({second for _, second in found}) == len(choices)
    for parts, (first, second) in zip(choices, found, strict=True):
        there = keys(elsewhere, *parts)
        assert there[0] == first
        assert (there[1] == second) == (not set(parts) - {"light"}), parts


def test_given_parts_are_a_set_and_contradictions_are_refused() -> None:
    assert Variant(given=("indirect", "light", "light")) == Variant(given=("light", "indirect"))
    with pytest.raises(UsageError, match="no part 'shape'"):
        Variant(given=("shape",))  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="a choice of effects"):
        Variant(given=("light",), effects="auto")
    with pytest.raises(UsageError, match="split-sum"):
        Variant(given=("indirect",), shading="split-sum")
    assert Variant(given=("light",), shading="split-sum").given == ("light",)


@pytest.mark.parametrize(
    ("part", "lacks"),
    [("geometry", "surfaces"), ("albedo", "surfaces"), ("roughness", "surfaces"), ("light", "light"),
     ("indirect", "surfaces and light")],
)  # fmt: skip
def test_a_scene_whose_truth_is_not_known_is_refused_before_stage_one(part: Part, lacks: str) -> None:
    captured = replace(KNOWN, surfaces=None, training_light=None)
    run = Run(captured, Variant(given=(part,)), BUDGET, 0, CPU)
    with pytest.raises(DataError, match=f"the true {lacks} of scene 'sphere' .* '{part}' cannot be given"):
        RADIOGS.stages(run.variant, run.budget)[0].begin(run, {})
    require_truth(captured, ())
    require_truth(KNOWN, PARTS)
