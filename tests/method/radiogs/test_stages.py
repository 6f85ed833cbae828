"""Both stages, on a scene of a few pixels, learn, resume bit for bit, and stop at the first NaN.

The light that stage 2 begins under: what its search simulates, and whether it is held or learnt.
"""

from dataclasses import replace
from typing import Any

import pytest
import torch

from radiogs.initialise import Initialisation
from radiogs.invert import InverseRendering
from radiogs.method import RADIOGS, inverse_rendering
from radiogs.model import Model
from radiogs.settings import INVERSE_ONLY, Budget, Variant
from radiogs.start import make_start
from radiogs_core.contract import Run
from radiogs_core.errors import NumericalFailure
from radiogs_core.instruments import recording
from radiogs_core.plain_values import with_values
from radiogs_core.transport.prefiltered_light import PrefilteredLight
from short_training import BUDGET, CPU, PROBED, SCENE, resumed, same_tensors, through_a_file


def inverse(initialised: dict[str, Any], variant: Variant | None = None) -> InverseRendering:
    return inverse_rendering(Run(SCENE, variant or Variant(), BUDGET, 0, CPU), initialised)


class WithoutStageTwo(Budget):
    def __getattribute__(self, name: str) -> Any:
        assert name not in INVERSE_ONLY, f"stage 1 reads {name}"
        return super().__getattribute__(name)


def test_stage_one_reads_no_budget_field_of_stage_two(initialised: dict[str, Any]) -> None:
    """Runs that differ only in stage 2 share stage 1, so it must not depend on fields that its key leaves out."""
    stage = Initialisation(Run(SCENE, Variant(), WithoutStageTwo(**vars(BUDGET)), 0, CPU))
    for _ in range(stage.iterations):
        stage.step()
    found = through_a_file(stage.state())
    for name, value in initialised["optimiser"]["tensors"].items():
        assert torch.equal(found["optimiser"]["tensors"][name], value), name


@pytest.mark.parametrize("kind", ["radiometric", "nvs"])
def test_initialisation_resumes_bit_for_bit_across_density_control(kind: str) -> None:
    variant = Variant(initialise=kind)  # type: ignore[arg-type]
    assert same_tensors(*resumed(lambda: Initialisation(Run(SCENE, variant, BUDGET, 0, CPU)), 7, 20))


def test_inverse_rendering_resumes_bit_for_bit_across_a_refresh(initialised: dict[str, Any]) -> None:
    whole, again = resumed(lambda: inverse(initialised), 6, 14)
    assert same_tensors(whole, again)
    assert torch.equal(whole.shader.cache.incident.radiance, again.shader.cache.incident.radiance)


def test_under_a_light_that_is_held_the_radiance_that_arrives_follows_each_tracing(initialised: dict[str, Any]) -> None:
    """Also across a refresh, against the radiance under the same light as if it were learnt."""
    stage = inverse(initialised)
    stage.optimiser.tensors["log_environment"].requires_grad_(False)
    refresh = BUDGET.refresh_interval
    for _ in range(refresh + 3):
        stage.step()
        model, outgoing = stage.model, stage.model.surfels.frame[..., 2].detach()
        light = PrefilteredLight(model.environment)
        learnt = replace(model, log_environment=model.log_environment.clone().requires_grad_())
        expected = stage.shader.radiance(learnt, outgoing, light)
        torch.testing.assert_close(stage.shader.radiance(model, outgoing, light), expected, rtol=1e-5, atol=1e-6)


def test_a_plan_decided_during_training_resumes_bit_for_bit(initialised: dict[str, Any]) -> None:
    """There are two probes, one before the checkpoint and one after it."""

    def begin() -> InverseRendering:
        stage = begun(initialised, PROBED, effects="auto")
        stage.planning.at = frozenset({0, 10})
        return stage

    whole, again = resumed(begin, 8, 18)
    assert same_tensors(whole, again)
    assert whole.planning.evidence == again.planning.evidence
    assert {record.iteration for record in whole.planning.evidence} == {0, 10}
    assert whole.plan == again.plan == again.cache.plan
    assert whole.plan.kept


def test_rays_and_time_of_a_probe_are_counted_separately(initialised: dict[str, Any]) -> None:
    """The first probe traces its directions once from every surfel; steps without a probe do not count as one."""
    stage = begun(initialised, PROBED, effects="auto")
    with recording() as instruments:
        stage.step()
        once = len(stage.optimiser.surfels) * stage.planning.samples
        taken = dict(instruments.parts)
        assert instruments.work["probe_rays"] == once <= instruments.work["rays"]
        assert taken["probe"] > 0
        stage.step()
    assert instruments.work["probe_rays"] == once
    assert instruments.parts == taken


@pytest.mark.parametrize(
    ("variant", "learns"),
    [
        (Variant(), {"sh", "albedo_logit"}),
        (Variant(detach="pbr"), {"sh"}),
        (Variant(detach="surfel", incident="detached"), {"albedo_logit"}),
        # Light traced in a step has gradient to the hit surfels' radiance; precomputed light has none.
        (Variant(incident="precomputed", detach="surfel"), {"albedo_logit"}),
        (Variant(shading="split-sum", detach="none"), {"sh", "albedo_logit"}),
    ],
)
def test_detaching_one_side_of_the_residual_cuts_its_gradient(
    initialised: dict[str, Any], variant: Variant, learns: set[str]
) -> None:
    stage = inverse(initialised, variant)
    loss = stage.consistency_loss(stage.model, stage.views[0])
    loss.backward()
    moved = {
        name
        for name in ("sh", "albedo_logit")
        if (gradient := stage.optimiser.tensors[name].grad) is not None and bool((gradient != 0).any())
    }
    assert moved == learns


def test_without_radiometric_weight_there_is_no_gradient_but_the_cache_is_updated(initialised: dict[str, Any]) -> None:
    stage = inverse(initialised, Variant(radiometric_weight=0.0))
    before = stage.shader.cache.incident.direction.clone()
    loss = stage.consistency_loss(stage.model, stage.views[0])
    assert not loss.requires_grad
    assert float(loss) == 0
    assert not torch.equal(before, stage.shader.cache.incident.direction)


def test_a_nan_in_one_surfel_is_named_with_its_iteration(initialised: dict[str, Any]) -> None:
    stage = inverse(initialised)
    stage.step()
    with torch.no_grad():
        stage.optimiser.tensors["albedo_logit"][17, 1] = torch.nan
    with pytest.raises(
        NumericalFailure, match="'albedo_logit' is not finite in stage 'invert' at iteration 1: surfel 17"
    ):
        stage.step()


def test_runs_of_equal_seeds_count_equal_work(initialised: dict[str, Any]) -> None:
    counts = []
    for _ in range(2):
        with recording() as instruments:
            stage = inverse(initialised)
            for _ in range(3):
                stage.step()
        counts.append(dict(instruments.work))
    assert counts[0] == counts[1]
    assert counts[0]["rays"] > 0


@pytest.mark.parametrize("variant", [Variant(effects="auto"), Variant(shading="split-sum")])
def test_the_product_of_stage_two_is_the_model(initialised: dict[str, Any], variant: Variant) -> None:
    stage = inverse(initialised, variant)
    stage.step()
    restored = Model.of(through_a_file(stage.product()))
    assert torch.equal(restored.environment, stage.model.environment)
    assert restored.plan == stage.model.plan
    assert list(restored.evidence) == list(stage.model.evidence)
    for name, value in restored.surfels.parameters().items():
        assert torch.equal(value, stage.model.surfels.parameters()[name]), name


def begun(initialised: dict[str, Any], budget: Budget = BUDGET, **changed: Any) -> InverseRendering:
    return inverse_rendering(Run(SCENE, with_values(Variant(), changed), budget, 0, CPU), initialised)


@pytest.mark.parametrize(
    ("changed", "traces"),
    [
        ({}, True),
        ({"shading": "split-sum"}, False),
        ({"effects": ("specular",)}, False),
        ({"effects": ("visibility",)}, True),
        ({"effects": "auto"}, True),
    ],
    ids=["default", "split-sum", "specular", "visibility", "auto"],
)
def test_the_search_for_the_light_traces_rays_only_where_stage_2_does(
    initialised: dict[str, Any], changed: dict[str, Any], traces: bool
) -> None:
    with recording() as counted:
        start = begun(initialised, **changed).start
    assert not torch.equal(start.log_environment, start.log_environment.mean().expand_as(start.log_environment))
    assert (counted.work["rays"] > 0) == traces


SHORT = {"materials.start.search.steps": 3}
ALIKE: list[dict[str, Any]] = [
    {"radiometric_weight": 0.0}, {"detach": "pbr"}, {"incident": "precomputed"}, {"masking": "height-correlated"},
    {"deviations": ("fixed-offset", "hemisphere-floor", "light-detached"), "ray_offset": 0.1},
    {"effects": ("visibility", "indirect")}, {"materials.rates.light": 0.0005}, {"relighting": "surfels"},
]  # fmt: skip
OTHERS: list[dict[str, Any]] = [
    {"view_share": 0.5}, {"materials.start.roughness": 0.4}, {"materials.start.search.colour": 0.5},
    {"materials.start.light": "constant"}, {"deviations": ("start-light",)}, {"deviations": ("one-sided-rays",)},
    {"shading": "split-sum"}, {"effects": ("visibility",)}, {"effects": "auto"},
]  # fmt: skip


@pytest.mark.parametrize(("changed", "alike"), [*((each, True) for each in ALIKE), *((each, False) for each in OTHERS)])
def test_variants_share_a_start_exactly_if_it_is_the_same(
    initialised: dict[str, Any], changed: dict[str, Any], alike: bool
) -> None:
    whole, other = (with_values(Variant(), SHORT | some) for some in ({}, changed))
    starts = [RADIOGS.stages(variant, BUDGET)[1].start for variant in (whole, other)]
    made = [make_start(Run(SCENE, variant, BUDGET, 0, CPU), initialised) for variant in (whole, other)]
    assert (starts[0].reads == starts[1].reads) == alike
    assert same(*made) == alike


def same(one: Any, other: Any) -> bool:
    """Whether two products are equal to the last bit."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(value, other[name]) for name, value in one.items())
    return torch.equal(one, other) if isinstance(one, torch.Tensor) else bool(one == other)


@pytest.mark.parametrize("effects", ["all", "auto"])
def test_stage_2_goes_on_from_a_stored_start_as_from_one_just_made(initialised: dict[str, Any], effects: str) -> None:
    run = Run(SCENE, with_values(Variant(), SHORT | {"effects": effects}), BUDGET, 0, CPU)
    spec = RADIOGS.stages(run.variant, run.budget)[1]
    whole = spec.begin(run, initialised)
    shared = spec.start.begin(run, through_a_file(spec.start.make(run, initialised)))
    for _ in range(2):
        assert shared.step() == whole.step()
    assert same(shared.state(), whole.state())


def test_stage_2_draws_other_random_numbers_than_its_start(initialised: dict[str, Any]) -> None:
    stage = begun(initialised, shading="split-sum")  # draws none while it begins
    fresh = torch.Generator().manual_seed(0)
    assert torch.equal(stage.generator.get_state(), make_start(stage_run(), initialised)["generator"])
    assert not torch.equal(stage.generator.get_state(), fresh.get_state())


def stage_run() -> Run:
    return Run(SCENE, with_values(Variant(), {"shading": "split-sum"}), BUDGET, 0, CPU)


@pytest.mark.parametrize(
    ("changed", "rate", "learnt"),
    [
        ({}, 0.0, False),
        ({"materials.rates.light": 0.0005}, 0.0005, True),
        ({"materials.start.light": "constant"}, 0.01, True),
        ({"deviations": ("start-light",)}, 0.01, True),
    ],
    ids=["searched", "searched-and-learnt", "constant", "start-light"],
)
def test_a_light_that_was_searched_for_is_held_and_a_constant_one_is_learnt(
    initialised: dict[str, Any], changed: dict[str, Any], rate: float, learnt: bool
) -> None:
    stage = begun(initialised, **changed)
    before = stage.model.log_environment.detach().clone()
    for _ in range(3):
        stage.step()
    assert stage.optimiser.rates["log_environment"] == rate
    assert (not torch.equal(stage.model.log_environment, before)) == learnt
