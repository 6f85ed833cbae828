"""Both stages, on a scene of a few pixels, learn, resume bit for bit, and stop at the first NaN."""

from dataclasses import replace
from typing import Any

import pytest
import torch

from radiogs.initialise import Initialisation
from radiogs.invert import InverseRendering
from radiogs.method import inverse_rendering
from radiogs.model import Model
from radiogs.settings import INVERSE_ONLY, Budget, Variant
from radiogs_core.contract import Run, Stage
from radiogs_core.errors import NumericalFailure
from radiogs_core.instruments import recording
from radiogs_core.plain_values import with_values
from radiogs_core.transport.splitsum import PrefilteredLight
from short_training import BUDGET, CPU, SCENE, resumed, same_tensors, through_a_file


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
    whole, again = resumed(lambda: inverse(initialised, Variant(effects="auto")), 8, 18)
    assert same_tensors(whole, again)
    assert whole.planner.evidence == again.planner.evidence
    assert {record.iteration for record in whole.planner.evidence} == {0, 10}
    assert whole.planner.plan == again.planner.plan


def test_rays_and_time_of_a_probe_are_counted_separately(initialised: dict[str, Any]) -> None:
    """The first probe traces its directions once from every surfel; steps without a probe do not count as one."""
    stage = inverse(initialised, Variant(effects="auto"))
    with recording() as instruments:
        stage.step()
        once = len(stage.optimiser.surfels) * stage.planner.samples
        taken = dict(instruments.parts)
        assert instruments.work["probe_rays"] == once <= instruments.work["rays"]
        assert taken["probe"] > 0
        stage.step()
    assert instruments.work["probe_rays"] == once
    assert instruments.parts == taken


def test_initialisation_learns_the_images() -> None:
    longer = with_values(BUDGET, {"geometry.steps": 120, "geometry.densify_interval": 20})
    stage = Initialisation(Run(SCENE, Variant(), longer, 0, CPU))
    history = [stage.step()["radiance"] for _ in range(120)]
    # Eight steps are every view on both backgrounds.
    assert sum(history[-8:]) < 0.7 * sum(history[:8])


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


def test_without_radiometric_weight_there_is_no_gradient_but_the_cache_is_updated(
    initialised: dict[str, Any],
) -> None:
    stage = inverse(initialised, Variant(radiometric_weight=0.0))
    before = stage.shader.cache.incident.direction.clone()
    loss = stage.consistency_loss(stage.model, stage.views[0])
    assert not loss.requires_grad
    assert float(loss) == 0
    assert not torch.equal(before, stage.shader.cache.incident.direction)


def test_novel_view_initialisation_has_no_loss_of_shading() -> None:
    losses = Initialisation(Run(SCENE, Variant(initialise="nvs"), BUDGET, 0, CPU)).step()
    assert "shaded" not in losses
    assert "consistency" not in losses


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


def test_both_stages_implement_the_stage_protocol(initialised: dict[str, Any]) -> None:
    first = Initialisation(Run(SCENE, Variant(), BUDGET, 0, CPU))
    second = inverse(first.product())
    assert isinstance(first, Stage)
    assert isinstance(second, Stage)
