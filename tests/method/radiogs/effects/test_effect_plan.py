"""A plan saves the work of the effects that it leaves out, by the counters, and the remaining light does not change."""

import dataclasses
from typing import Any
from unittest.mock import Mock

import pytest
import torch
from torch.nn.functional import normalize

from radiogs import kept_light
from radiogs.effects.plans import Step
from radiogs.effects.probe import Assessment
from radiogs.invert import InverseRendering
from radiogs.kept_light import CELLS, KeptLight, cells, middles
from radiogs.learning import MaterialLearning, MaterialStart
from radiogs.method import RADIOGS, inverse_rendering
from radiogs.settings import Variant
from radiogs.showing import Renderer
from radiogs_bench.sources import installed
from radiogs_core.contract import Run
from radiogs_core.errors import UsageError
from radiogs_core.instruments import recording
from radiogs_core.kernels.trace.bvh import SurfelBVH
from radiogs_core.plain_values import with_values
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.plan import EFFECTS, EffectPlan, plan_of
from radiogs_core.transport.tracer import SurfelTracer, gather_incident
from short_training import BUDGET, CPU, PROBED, SCENE


def but(*off: str) -> tuple[str, ...]:
    return tuple(name for name in EFFECTS if name not in off)


def work_of(initialised: dict[str, Any], *off: str, steps: int = 12) -> tuple[dict[str, int], InverseRendering]:
    stage = inverse_rendering(Run(SCENE, Variant(effects=but(*off)), BUDGET, 0, CPU), initialised)
    with recording() as instruments:
        for _ in range(steps):
            stage.step()
    return dict(instruments.work), stage


def test_without_visibility_and_indirect_light_no_ray_is_traced_and_no_tree_is_built(
    initialised: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    counted, stage = work_of(initialised, "visibility", "indirect")
    assert not any(counted.get(name) for name in ("rays", "node_visits", "leaf_visits", "hits"))
    with monkeypatch.context() as patch:
        patch.setattr(SurfelBVH, "build", Mock(side_effect=RuntimeError("the first tree")))
        with pytest.raises(RuntimeError, match="the first tree"):
            _ = stage.cache.tracer.bvh
    with recording() as instruments:
        Renderer(stage.model, 8, stage.variant).render(SCENE.test[0].camera)
    assert not instruments.work["rays"]


@pytest.mark.slow
def test_every_effect_that_is_off_saves_its_own_work(initialised: dict[str, Any]) -> None:
    whole, _ = work_of(initialised)
    assert whole["rays"] > 0
    assert whole["lobes"] == whole["shaded_samples"]
    assert work_of(initialised, "specular")[0]["lobes"] == 0
    assert work_of(initialised, "view-dependence")[0]["bytes_read"] < whole["bytes_read"]
    half = work_of(initialised, "samples")[0]
    assert (2 * half["rays"], 2 * half["shaded_samples"]) == (whole["rays"], whole["shaded_samples"])
    # Twelve steps contain one refresh of all surfels, at the tenth; with twice the interval they contain none.
    seldom = work_of(initialised, "refresh")[0]
    surfels = len(initialised["optimiser"]["tensors"]["centre"])
    cached = Variant().materials.directions.sets * BUDGET.incident_samples
    assert whole["rays"] - seldom["rays"] == cached * surfels


@pytest.mark.slow
def test_a_list_of_all_effects_is_the_full_method(initialised: dict[str, Any]) -> None:
    named = work_of(initialised)[1].optimiser.tensors
    full = inverse_rendering(Run(SCENE, Variant(), BUDGET, 0, CPU), initialised)
    for _ in range(12):
        full.step()
    assert all(torch.equal(value, named[name]) for name, value in full.optimiser.tensors.items())


@pytest.mark.parametrize("off", ["visibility", "indirect"])
def test_visibility_or_indirect_light_alone_uses_the_same_rays(initialised: dict[str, Any], off: str) -> None:
    surfels = inverse_rendering(Run(SCENE, Variant(), BUDGET, 0, CPU), initialised).model.surfels
    tracer = SurfelTracer(surfels)
    whole = gather_incident(tracer, surfels, 8, None)
    free = tracer.untraced(torch.arange(len(surfels)), whole.direction, whole.weight)
    part = gather_incident(tracer, surfels, 8, None, plan=EffectPlan().without(off))
    assert torch.equal(part.visibility, (free if off == "visibility" else whole).visibility)
    assert torch.equal(part.radiance, (free if off == "indirect" else whole).radiance)
    assert not torch.equal(free.visibility, whole.visibility)
    assert whole.radiance.any()


NO_RAYS = EffectPlan(visibility=False, indirect=False, kept=True)


def copy_of(incident: Incident) -> Incident:
    return Incident(**{name: value.clone() for name, value in vars(incident).items()})


def decided(initialised: dict[str, Any], plan: EffectPlan, **changes: Any) -> InverseRendering:
    """Stage 2 after a probe that has decided for ``plan``."""
    stage = inverse_rendering(Run(SCENE, Variant(effects="auto", **changes), BUDGET, 0, CPU), initialised)
    stage.planning.plan = plan
    stage.cache.adopt(plan, stage.model, 0)
    return stage


def stepped(stage: InverseRendering) -> Incident:
    """The cached light after twelve steps, including one refresh."""
    for _ in range(12):
        stage.step()
    return stage.cache.incident


def test_a_plan_that_keeps_light_begins_with_rays_of_all_surfels(initialised: dict[str, Any]) -> None:
    plain = MaterialLearning(start=MaterialStart(light="constant"))  # the search for the light traces rays of its own
    stage = inverse_rendering(Run(SCENE, Variant(materials=plain), BUDGET, 0, CPU), initialised)
    with recording() as instruments:
        stage.cache.adopt(NO_RAYS, stage.model, 0)
    assert instruments.work["rays"] == len(stage.cache.incident.weight) * CELLS**2


def test_directions_fall_into_the_cell_whose_middle_they_go_through() -> None:
    middle = normalize(middles(torch.zeros(0)), dim=-1)
    assert bool((middle[:, 2] > 0).all())
    assert torch.equal(cells(middle), torch.arange(CELLS**2))
    below = torch.tensor([[0.6, 0.0, -0.8], [0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    assert bool((cells(below) < CELLS**2).all())
    assert torch.equal(cells(below[:1]), cells(torch.tensor([[1.0, 0.0, 0.0]])))
    drawn = torch.randn(20_000, 3, generator=torch.Generator().manual_seed(0))
    drawn = normalize(torch.cat([drawn[:, :2], drawn[:, 2:].abs()], -1), dim=-1)
    apart = (drawn * middle[cells(drawn)]).sum(-1).clamp(max=1).acos().rad2deg()
    assert float(apart.max()) < 10
    # Cells share the hemisphere by their solid angles: so many of the random directions fall into each.
    light = KeptLight(torch.eye(3)[None], torch.ones(1, CELLS**2), torch.ones(1, CELLS**2, 3))
    share = light.through(torch.arange(CELLS**2)).weight[0] / (2 * torch.pi)
    assert float(share.sum()) == pytest.approx(1)
    counted = torch.bincount(cells(drawn), minlength=CELLS**2) / len(drawn)
    rows = torch.stack([share, counted]).view(2, CELLS, CELLS).sum(-1)
    torch.testing.assert_close(rows[0], rows[1], rtol=0.1, atol=0)


def is_kept(now: Incident, kept: KeptLight) -> bool:
    """Whether each surfel has, along each direction, V and L_ind of the cell that the direction falls into."""
    row, cell = torch.arange(len(now.weight))[:, None], cells(now.direction @ kept.frame)
    same = torch.equal(now.visibility, kept.visibility[row, cell])
    return same and torch.equal(now.radiance, kept.radiance[row, cell])


def test_light_is_kept_after_a_probe_removed_all_rays_along_directions_that_are_drawn_as_rays_were(
    initialised: dict[str, Any],
) -> None:
    """Directions that stayed would keep the noise of their sums, and materials would be fitted to it."""
    stage = decided(initialised, NO_RAYS)
    before = copy_of(stage.cache.incident)
    assert is_kept(before, stage.cache.kept)
    with recording() as instruments:
        stage.step()
        anew = (before.direction != stage.cache.incident.direction).any(-1)
        assert int(anew.any(-1).sum()) == min(BUDGET.consistency_surfels, len(anew))
        assert int(anew.sum()) == int(anew.any(-1).sum()) * anew.shape[1] // stage.cache.sets
        for _ in range(BUDGET.refresh_interval):
            stage.step()
    assert not instruments.work["rays"]
    assert bool((before.direction != stage.cache.incident.direction).any(-1).all())
    assert is_kept(stage.cache.incident, stage.cache.kept)


@pytest.mark.slow
@pytest.mark.parametrize("plan", [NO_RAYS, EffectPlan()])
def test_arriving_light_comes_from_the_cache_in_every_step(initialised: dict[str, Any], plan: EffectPlan) -> None:
    """It is kept from step to step, and brought up to date where directions were drawn anew: at a refresh, too."""
    ended = []
    for anew in (False, True):
        stage = decided(initialised, plan)
        assert not stage.model.log_environment.requires_grad
        for _ in range(12):
            if anew:
                stage.shader.arriving = None
            stage.step()
        ended.append(stage.optimiser.tensors)
    for name, value in ended[0].items():
        assert torch.equal(value, ended[1][name]), name


@pytest.mark.slow
def test_kept_light_is_looked_up_in_parts(initialised: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    whole = stepped(decided(initialised, NO_RAYS))
    monkeypatch.setattr(kept_light, "DIRECTIONS_AT_ONCE", 1)
    parts = stepped(decided(initialised, NO_RAYS))
    assert all(torch.equal(value, getattr(parts, name)) for name, value in vars(whole).items())


def test_a_probe_that_leaves_out_rays_is_restored_with_the_light_that_it_kept(initialised: dict[str, Any]) -> None:
    stage, again = decided(initialised, NO_RAYS), decided(initialised, EffectPlan())
    index = torch.tensor([5, 3, 9, 1])
    light = stage.cache.light_on(index, stage.model, 1)
    assert is_kept(light, KeptLight(*(value[index] for value in vars(stage.cache.kept).values())))
    assert all(torch.equal(value, getattr(stage.cache.of_set(index, 1), name)) for name, value in vars(light).items())
    assert not light.visibility.requires_grad
    assert again.cache.light_on(index, again.model, 1).radiance.requires_grad
    again.restore(stage.state())
    assert again.cache.plan == NO_RAYS
    assert is_kept(again.cache.incident, again.cache.kept)


@pytest.mark.slow
@pytest.mark.parametrize("other", [False, True])
def test_a_plan_with_other_rays_renews_the_cached_light(
    initialised: dict[str, Any], monkeypatch: pytest.MonkeyPatch, other: bool
) -> None:
    """The second probe comes after half of the steps."""
    stage = inverse_rendering(Run(SCENE, Variant(effects="auto"), PROBED, 0, CPU), initialised)
    plans = iter([NO_RAYS, EffectPlan() if other else NO_RAYS])

    def observe(*arguments: Any) -> EffectPlan:
        before, stage.planning.plan = stage.planning.plan, next(plans)
        return before

    monkeypatch.setattr(stage.planning, "observe", observe)
    stage.step()
    assert stage.cache.incident.radiance.any()
    kept, stage.iteration = stage.cache.kept, PROBED.inverse_iterations // 2
    stage.begin_step()
    assert (stage.cache.kept is not kept) == other
    assert stage.cache.plan is stage.plan


def test_a_model_with_kept_light_is_rendered_with_rays_of_all_surfels(initialised: dict[str, Any]) -> None:
    model = inverse_rendering(Run(SCENE, Variant(), BUDGET, 0, CPU), initialised).model
    camera = SCENE.test[0].camera

    def image(plan: EffectPlan) -> torch.Tensor:
        return Renderer(dataclasses.replace(model, plan=plan), 8, Variant()).render(camera)["image"]

    assert torch.equal(image(NO_RAYS), image(EffectPlan()))
    assert not torch.equal(image(dataclasses.replace(NO_RAYS, kept=False)), image(EffectPlan()))


@pytest.mark.slow
@pytest.mark.parametrize("off", [("indirect",), ("visibility",), ("specular",)])
def test_gradients_flow_only_through_simulated_effects(initialised: dict[str, Any], off: tuple[str, ...]) -> None:
    learnt = {"materials.rates.light": 5e-4, "materials.consistent_roughness": True}
    variant = with_values(Variant(effects=but(*off)), learnt)
    stage = inverse_rendering(Run(SCENE, variant, BUDGET, 0, CPU), initialised)
    loss = stage.consistency_loss(stage.visible_model(), stage.views[0])
    loss.backward()
    gradient = {name: value.grad for name, value in stage.optimiser.tensors.items()}
    moved = {name for name, value in gradient.items() if value is not None and bool((value != 0).any())}
    assert {"albedo_logit", "sh", "log_environment"} <= moved
    assert ("roughness_logit" in moved) == ("specular" not in off)


def test_only_effects_by_evidence_make_stage_2_depend_on_their_code() -> None:
    for effects, depends in (("all", False), (but("specular"), False), ("auto", True)):
        variant = Variant(effects=effects)
        modules = installed().closure(*RADIOGS.stages(variant, BUDGET)[1].sources)
        for name in ("radiogs.effects.training", "radiogs.effects.bounds"):
            assert (name in modules) == depends


def test_plans_list_the_effects_that_they_leave_out() -> None:
    assert EffectPlan().off == ()
    for name in EFFECTS:
        assert plan_of(but(name)).off == (name,)
    assert not plan_of(()).traces
    assert plan_of("auto") == EffectPlan()


def test_variants_sort_effects_and_refuse_unknown_ones() -> None:
    assert Variant(effects=("specular", "visibility")).effects == ("visibility", "specular")
    for wrong in ("some", ("visbility",)):
        with pytest.raises(UsageError, match="unknown effect"):
            Variant(effects=wrong)
    with pytest.raises(UsageError, match="split-sum"):
        Variant(shading="split-sum", effects="auto")


@pytest.mark.parametrize("iteration", [1, BUDGET.refresh_interval])
def test_rays_give_gradient_to_hit_surfels_in_refresh_steps_too(initialised: dict[str, Any], iteration: int) -> None:
    stage = inverse_rendering(Run(SCENE, Variant(), BUDGET, 0, CPU), initialised)
    stage.iteration = iteration
    stage.consistency_loss(stage.visible_model(), stage.views[0]).backward()
    for name in ("log_scale", "opacity_logit"):  # only rays give gradient to these here
        gradient = stage.optimiser.tensors[name].grad
        assert gradient.any()


def test_a_plan_counts_as_left_out_only_if_it_saves_no_more_than_before() -> None:
    assessment = Assessment.__new__(Assessment)
    assessment.step = Step(100, 20, 8, 10)
    every, some, more = EffectPlan(), EffectPlan().without("indirect"), EffectPlan().without("samples")
    for before, plan, expected in ((some, some, True), (more, some, True), (some, more, False), (every, every, False)):
        assessment.before = before
        assert assessment.was_left_out(plan) == expected
