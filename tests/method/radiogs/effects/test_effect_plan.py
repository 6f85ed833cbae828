"""A plan saves the work of the effects that it leaves out, by the counters, and the remaining light does not change."""

import dataclasses
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest
import torch

from radiogs.effects import training as effect_training
from radiogs.effects.assessment import Assessment
from radiogs.effects.training import LastLight
from radiogs.invert import InverseRendering
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
from short_training import BUDGET, CPU, SCENE


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
            _ = stage.shader.cache.tracer.bvh
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


def test_tracing_some_surfels_gives_the_same_light_as_tracing_all(initialised: dict[str, Any]) -> None:
    stage = inverse_rendering(Run(SCENE, Variant(), BUDGET, 0, CPU), initialised)
    surfels = stage.model.surfels
    some = torch.arange(len(surfels)) % 3 == 0
    whole = gather_incident(SurfelTracer(surfels), surfels, 8, None)
    with recording() as instruments:
        part = gather_incident(SurfelTracer(surfels), surfels, 8, None, plan=EffectPlan(traced=some))
    assert instruments.work["rays"] == 8 * int(some.sum())
    assert torch.equal(part.visibility[some], whole.visibility[some])
    assert torch.equal(part.radiance[some], whole.radiance[some])
    free = SurfelTracer(surfels).untraced(torch.nonzero(~some)[:, 0], whole.direction[~some], whole.weight[~some])
    assert torch.equal(part.visibility[~some], free.visibility)
    assert not part.radiance[~some].any()


NO_RAYS = EffectPlan(visibility=False, indirect=False, kept=True)


def local_rays(initialised: dict[str, Any]) -> EffectPlan:
    some = torch.arange(len(initialised["optimiser"]["tensors"]["centre"])) % 3 == 0
    return EffectPlan(traced=some, kept=True)


def copy_of(incident: Incident) -> Incident:
    return Incident(**{name: value.clone() for name, value in vars(incident).items()})


def decided(initialised: dict[str, Any], plan: EffectPlan, **changes: Any) -> InverseRendering:
    """Stage 2 after a probe that has decided for ``plan``."""
    stage = inverse_rendering(Run(SCENE, Variant(effects="auto", **changes), BUDGET, 0, CPU), initialised)
    stage.planner.at = frozenset()
    stage.planner.plan = plan
    stage.shader.cache.renew(stage.model, 0)
    return stage


def stepped(stage: InverseRendering) -> tuple[dict[str, int], Incident, Incident]:
    """Work of twelve steps, one of them with a refresh, and the cached light before and after them."""
    before = copy_of(stage.shader.cache.incident)
    with recording() as instruments:
        for _ in range(12):
            stage.step()
    return dict(instruments.work), before, stage.shader.cache.incident


def test_a_plan_that_keeps_light_begins_with_rays_of_all_surfels(initialised: dict[str, Any]) -> None:
    plain = MaterialLearning(start=MaterialStart(light="constant"))  # the search for the light traces rays of its own
    whole = inverse_rendering(Run(SCENE, Variant(materials=plain), BUDGET, 0, CPU), initialised).shader.cache.incident
    for plan in (NO_RAYS, local_rays(initialised)):
        with recording() as instruments:
            stage = decided(initialised, plan, materials=plain)
        more = effect_training.KEPT_DIRECTIONS - whole.weight.shape[1]
        without = int(plan.without_rays(whole.weight).sum())
        assert instruments.work["rays"] == whole.weight.numel() + without * more
        stage.generator.manual_seed(0)
        stage.shader.cache.renew(stage.model, 0)
        for name, value in vars(whole).items():
            assert torch.equal(value, getattr(stage.shader.cache.incident, name))


def has_the_light_of_the_nearest_directions(now: Incident, last: LastLight, index: torch.Tensor) -> bool:
    """Whether surfels at ``index`` have, along each direction, V and L_ind of the nearest kept direction."""
    for direction, visibility, radiance, row in zip(
        now.direction, now.visibility, now.radiance, last.row[index], strict=True
    ):
        nearest = (direction[:, None] - last.direction[row]).norm(dim=-1).argmin(1)
        if not torch.equal(visibility, last.visibility[row][nearest]):
            return False
        if not torch.equal(radiance, last.radiance[row][nearest]):
            return False
    return True


def test_light_is_kept_after_a_probe_removed_all_rays_along_directions_that_are_drawn_anew(
    initialised: dict[str, Any],
) -> None:
    """Directions that stayed would keep the noise of their sums, and materials would be fitted to it."""
    stage = decided(initialised, NO_RAYS)
    every = torch.arange(len(stage.shader.cache.incident.weight))
    last = stage.shader.cache.last
    counted, before, after = stepped(stage)
    assert not counted.get("rays")
    assert bool((before.direction != after.direction).any(-1).all())
    assert last.direction.shape[1] >= effect_training.KEPT_DIRECTIONS
    assert has_the_light_of_the_nearest_directions(before, last, every), "the cached directions are kept ones"
    assert has_the_light_of_the_nearest_directions(after, last, every)


@pytest.mark.slow
@pytest.mark.parametrize("plan", [NO_RAYS, EffectPlan(indirect=False, kept=True), None])
def test_the_light_that_arrives_is_that_of_the_cache_in_every_step(
    initialised: dict[str, Any], plan: EffectPlan | None
) -> None:
    """It is kept from step to step, and brought up to date where directions were drawn anew: at a refresh, too, and
    after steps in which some surfels alone had lobes."""
    ended = []
    for anew in (False, True):
        stage = decided(initialised, local_rays(initialised) if plan is None else plan)
        assert not stage.model.log_environment.requires_grad
        lobes = (torch.arange(len(stage.model.surfels)) % 2 == 0, None)
        for step in range(12):
            if step in (4, 7):
                stage.planner.plan = dataclasses.replace(stage.planner.plan, specular_at=lobes[step == 7])
            if anew:
                stage.shader.arriving = None
            stage.step()
        ended.append(stage.optimiser.tensors)
    for name, value in ended[0].items():
        assert torch.equal(value, ended[1][name]), name


@pytest.mark.slow
def test_kept_light_is_looked_up_in_parts(initialised: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    whole = stepped(decided(initialised, NO_RAYS))[2]
    monkeypatch.setattr(effect_training, "COMPARED", 1)
    parts = stepped(decided(initialised, NO_RAYS))[2]
    assert all(torch.equal(value, getattr(parts, name)) for name, value in vars(whole).items())


@pytest.mark.slow
def test_surfels_without_rays_keep_their_light_while_others_are_traced(initialised: dict[str, Any]) -> None:
    plan = local_rays(initialised)
    whole = stepped(inverse_rendering(Run(SCENE, Variant(), BUDGET, 0, CPU), initialised))[0]
    stage = decided(initialised, plan)
    last = stage.shader.cache.last
    counted, before, after = stepped(stage)
    assert 0 < counted["rays"] < 0.5 * whole["rays"]
    without = torch.nonzero(~plan.traced)[:, 0]
    assert len(last.direction) == len(without)
    assert has_the_light_of_the_nearest_directions(after.of(without), last, without)
    assert bool((before.direction != after.direction).any(-1).any(-1).all())


def test_kept_and_traced_light_are_assigned_to_the_right_surfels(initialised: dict[str, Any]) -> None:
    plan = local_rays(initialised)
    stage = decided(initialised, plan)
    index = torch.tensor([5, 3, 9, 1])
    before = stage.shader.cache.of_set(index, 1)
    light = stage.shader.cache.light_on(index, stage.model, 1)
    assert light.visibility.requires_grad or light.radiance.requires_grad
    for row, surfel in enumerate(index.tolist()):
        for name in vars(light):
            value = getattr(light, name)[row]
            assert torch.equal(value, getattr(stage.shader.cache.of_set(index, 1), name)[row])
        assert not torch.equal(light.direction[row], before.direction[row])
        if not plan.traced[surfel]:
            one = light.of(torch.tensor([row])), stage.shader.cache.last, torch.tensor([surfel])
            assert has_the_light_of_the_nearest_directions(*one)


@pytest.mark.slow
@pytest.mark.parametrize(("incident", "renewed"), [("traced", True), ("precomputed", False)])
def test_a_plan_with_other_rays_renews_the_cached_light_unless_it_is_precomputed(
    initialised: dict[str, Any], monkeypatch: pytest.MonkeyPatch, incident: Any, renewed: bool
) -> None:
    """Both probes change the plan; the second one comes after half of the steps."""
    stage = inverse_rendering(Run(SCENE, Variant(effects="auto", incident=incident), BUDGET, 0, CPU), initialised)

    def without_rays(*arguments: Any) -> bool:
        stage.planner.plan = NO_RAYS
        return True

    monkeypatch.setattr(stage.planner, "observe", without_rays)
    stage.step()
    before = copy_of(stage.shader.cache.incident)
    assert before.radiance.any()
    while stage.iteration < stage.iterations:
        stage.step()
    assert torch.equal(before.direction, stage.shader.cache.incident.direction) != renewed


def test_a_model_with_kept_light_is_rendered_with_rays_of_all_surfels(initialised: dict[str, Any]) -> None:
    model = inverse_rendering(Run(SCENE, Variant(), BUDGET, 0, CPU), initialised).model
    camera = SCENE.test[0].camera

    def image(plan: EffectPlan) -> torch.Tensor:
        return Renderer(dataclasses.replace(model, plan=plan), 8, Variant()).render(camera)["image"]

    for plan in (NO_RAYS, local_rays(initialised)):
        assert torch.equal(image(plan), image(EffectPlan()))
        assert not torch.equal(image(dataclasses.replace(plan, kept=False)), image(EffectPlan()))


@pytest.mark.slow
def test_without_indirect_light_occluders_keep_their_mean_radiance(
    initialised: dict[str, Any],
) -> None:
    plan = EffectPlan(indirect=False, kept=True)
    stage = decided(initialised, plan)
    index = stage.shader.cache.incident.radiance.sum((1, 2)).topk(3).indices
    before = copy_of(stage.shader.cache.incident.of(index))
    light = stage.shader.cache.light_on(index, stage.model, 1)
    assert light.visibility.requires_grad
    for row in range(3):
        weight = before.weight[row]
        hidden = ((1 - before.visibility[row]) * weight).sum()
        mean = (before.radiance[row] * weight[:, None]).sum(0) / hidden if hidden > 0 else torch.zeros(3)
        expected = (1 - light.visibility[row])[:, None] * mean
        torch.testing.assert_close(light.radiance[row], expected)
    assert light.radiance.any()
    bare = decided(initialised, dataclasses.replace(plan, kept=False))
    assert not bare.shader.cache.light_on(index, bare.model, 1).radiance.any()


@pytest.mark.parametrize(("samples", "count"), [(8, 4), (8, 3), (5, 2), (2, 4)])
def test_thinned_directions_cover_the_same_solid_angle(samples: int, count: int) -> None:
    direction = torch.randn(3, samples, 3, generator=torch.Generator().manual_seed(0))
    whole = Incident(direction, torch.full((3, samples), 2 * torch.pi / samples), direction[..., 0], direction)
    some = whole.thinned(count)
    assert some.weight.shape == (3, count)
    torch.testing.assert_close(some.weight.sum(1), whole.weight.sum(1))
    kept = [number * samples // count for number in range(count)]
    assert torch.equal(some.direction, direction[:, kept])
    assert torch.equal(some.visibility, direction[:, kept, 0])


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


@pytest.mark.parametrize("effects", ["auto", but("specular")])
def test_only_a_choice_of_effects_makes_stage_2_depend_on_their_code(effects: Any) -> None:
    for variant, depends in ((Variant(), False), (Variant(effects=effects), True)):
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
    assessment.step = SimpleNamespace(saving=lambda plan, full: len(plan.off) - len(full.off))  # type: ignore[assignment]
    some = EffectPlan().without("indirect")
    more = some.without("specular")
    assert assessment.was_left_out(some, some)
    assert assessment.was_left_out(some, more)
    assert not assessment.was_left_out(more, some)
    assert not assessment.was_left_out(EffectPlan(), EffectPlan())
