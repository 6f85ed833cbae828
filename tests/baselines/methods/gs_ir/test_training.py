"""Stage 2 of GS-IR: which parameters its losses change and which they do not, and that it resumes bit for bit."""

import math
from dataclasses import replace

import pytest
import torch

from baselines.methods.irgs.world import DOWN, sheet, together
from baselines.methods.stage_two import GEOMETRY, GS_IR, tensors_of
from known_ball import BALL, COLOUR, LOBE, SCENE, noise
from radiogs_baselines.methods.gs_ir.settings import Variant
from radiogs_baselines.methods.gs_ir.shading import View
from radiogs_baselines.methods.gs_ir.training import InverseRendering
from radiogs_core.surfels.surfels import Surfels

MATERIALS = {"albedo_logit", "roughness_logit", "metallic_logit"}
MOVING = {"centre", "rotation", "log_scale", "opacity_logit"}
CAPPED = together(BALL, sheet(1.4, DOWN, scale=0.8, opacity=0.95))
"""The ball under a lid 0.4 above its top; the lid is the last surfel."""

WIDE = 0.8 / SCENE.extent
"""A tau of twice the lid's distance, in extents."""


def metals(**changes: object) -> Variant:
    return GS_IR.variant(metallic=True, **changes)


def moved_by(stage: InverseRendering, steps: int = 1) -> set[str]:
    before = tensors_of(stage)
    for _ in range(steps):
        stage.step()
    after = tensors_of(stage)
    return {name for name, value in after.items() if not torch.equal(value, before[name])}


def uneven(stage: InverseRendering, *names: str) -> InverseRendering:
    """The stage with noise on some of its tensors."""
    state = stage.state()
    tensors = state["optimiser"]["tensors"]
    state["optimiser"]["tensors"] = tensors | {name: tensors[name] + noise(tensors[name], 0.5) for name in names}
    stage.restore(state)
    return stage


@pytest.mark.parametrize(
    ("weight", "moved"),
    [
        ("shaded", MATERIALS | MOVING | {"log_environment", "irradiance"}),
        ("smoothness", MATERIALS | MOVING),
        ("prior", {"roughness_logit", "metallic_logit"} | MOVING),
        ("light_smoothness", {"log_environment"}),
    ],
)
def test_each_loss_changes_the_parameters_it_depends_on(weight: str, moved: set[str]) -> None:
    """No loss depends on the surfels' own radiance."""
    stage = uneven(GS_IR.stage_of(metals(materials=GS_IR.only(**{weight: 1.0})), CAPPED), *MATERIALS, "log_environment")
    assert moved_by(stage) == moved


@pytest.mark.parametrize("scale", [0.0, 0.5])
def test_geometry_is_frozen_without_a_rate(scale: float) -> None:
    moved = moved_by(GS_IR.stage_of(GS_IR.variant(lr_scale=scale), CAPPED), 3)
    assert (moved >= set(GEOMETRY)) == (scale > 0)
    assert not moved & {"sh", "sh_rest"}
    assert moved >= {"albedo_logit", "roughness_logit", "log_environment", "irradiance"}
    if not scale:
        assert not moved & set(GEOMETRY)


def test_geometry_moves_at_its_share_of_the_final_rates_of_stage_one() -> None:
    stage = GS_IR.stage_of(GS_IR.variant(lr_scale=0.25))
    before, rates = tensors_of(stage), Variant().geometry.rates
    stage.step()
    after = tensors_of(stage)
    # Adam's first step is the rate itself; rotations and centres take longer ones in short runs.
    expected = {
        "centre": GS_IR.budget.geometry.rate * rates.position_end * SCENE.extent,
        "rotation": math.sqrt(GS_IR.budget.geometry.rate) * rates.rotation * rates.end_share,
        "log_scale": rates.scale * rates.end_share,
        "opacity_logit": rates.opacity * rates.end_share,
    }
    for name, rate in expected.items():
        largest = float((after[name] - before[name]).abs().max())
        assert largest == pytest.approx(0.25 * rate, rel=0.05), name


@pytest.mark.parametrize(
    ("turned", "lacks"),
    [({"occlusion": False}, {"irradiance"}), ({"indirect": False}, {"irradiance"}), ({}, set())],
)
def test_parameters_that_the_variant_lacks_are_not_learnt(turned: dict[str, bool], lacks: set[str]) -> None:
    stage = GS_IR.stage_of(GS_IR.variant(**turned))
    assert "metallic_logit" not in stage.optimiser.tensors
    assert {"irradiance"} - set(stage.optimiser.tensors) == lacks
    assert (stage.model.occlusion is None) == ("occlusion" in turned)
    stage.step()
    assert ("irradiance" in stage.product()) == (not lacks)


def test_occlusion_is_baked_from_stage_one_and_does_not_change() -> None:
    """Under the lid the ball's top is occluded; beside it, and without the lid, it is open."""
    stage = GS_IR.stage_of(GS_IR.variant(tau=WIDE), CAPPED, replace(GS_IR.budget, occlusion_corners=24))
    open_ball = GS_IR.stage_of(GS_IR.variant(tau=WIDE), budget=replace(GS_IR.budget, occlusion_corners=24))
    position = torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    found, free = (
        each.model.occlusion.openness(position, torch.nn.functional.normalize(position, dim=-1), 256)  # type: ignore[union-attr]
        for each in (stage, open_ball)
    )
    assert float(found[0]) < 0.3 < 0.8 < float(free[0])
    assert float(found[1]) == pytest.approx(float(free[1]), abs=0.02)
    before = stage.model.occlusion
    for _ in range(3):
        stage.step()
    assert stage.model.occlusion is before


def test_the_prior_lowers_metalness_and_raises_roughness() -> None:
    stage = GS_IR.stage_of(metals(materials=GS_IR.only(prior=1.0)))
    before = tensors_of(stage)
    for _ in range(3):
        stage.step()
    after = tensors_of(stage)
    seen = after["roughness_logit"] != before["roughness_logit"]
    assert bool(seen.any())
    assert bool((after["roughness_logit"] >= before["roughness_logit"]).all())
    assert bool((after["metallic_logit"] <= before["metallic_logit"]).all())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["albedo", "roughness", "metallic"])
def test_the_smoothness_loss_evens_out_materials(name: str) -> None:
    stage = uneven(GS_IR.stage_of(metals(lr_scale=0.0, materials=GS_IR.only(smoothness=1.0))), f"{name}_logit")
    losses = [stage.step()["smoothness"] for _ in range(30)]
    assert sum(losses[-3:]) < 0.8 * sum(losses[:3]), "all three views, at the end and at the beginning"


def test_materials_are_recovered_under_known_light_and_shape() -> None:
    """Under a light of 1 the ball sends COLOUR, so its albedo is COLOUR minus the lobe for every initial value."""
    still = replace(GS_IR.constant, rates=replace(GS_IR.constant.rates, light=0.0, albedo=0.2, roughness=0.0))
    stage = GS_IR.stage_of(GS_IR.variant(occlusion=False, lr_scale=0.0, materials=still))
    state = stage.state()
    state["optimiser"]["tensors"] = state["optimiser"]["tensors"] | {"log_environment": torch.zeros(8, 16, 3)}
    stage.restore(state)
    for _ in range(90):
        stage.step()
    surfels = stage.model.surfels
    seen = (surfels.albedo - 0.731).abs().sum(-1) > 1e-2
    found = surfels.albedo[seen].median(0).values
    torch.testing.assert_close(found, torch.tensor(COLOUR) - LOBE, rtol=0, atol=0.02)


def test_irradiance_is_learnt_where_the_light_is_occluded() -> None:
    """The images show the ball in a constant light of 1, also under the lid: there the volume has to add the light."""
    still = replace(GS_IR.constant, rates=replace(GS_IR.constant.rates, light=0.0, albedo=0.0, roughness=0.0))
    chosen = GS_IR.variant(tau=WIDE, lr_scale=0.0, materials=still)
    stage = GS_IR.stage_of(chosen, CAPPED, replace(GS_IR.budget, occlusion_corners=24, irradiance_corners=12))
    state = stage.state()
    known = {"log_environment": torch.zeros(8, 16, 3), "albedo_logit": CAPPED.albedo_logit}
    state["optimiser"]["tensors"] = state["optimiser"]["tensors"] | known
    stage.restore(state)

    def arriving() -> float:
        """Mean I at the visible part of the ball's top."""
        model, found = stage.model, []
        assert model.irradiance is not None
        for view in stage.views:
            points = View.of(view.camera, model, model.surfels.albedo).points
            top = points.of(torch.nonzero(points.normal[:, 2] > 0.8)[:, 0])
            found.append(model.irradiance.at(top.position, top.normal).detach())
        return float(torch.cat(found).mean())

    assert arriving() == 0
    for _ in range(60):
        stage.step()
    assert 0.5 < arriving() < 1.2


@pytest.mark.parametrize("changed", [{"texel_areas": "approximate"}, {"masking": "schlick"}])
def test_training_filters_and_reflects_the_light_as_the_variant_says(changed: dict[str, str]) -> None:
    """With approximate areas the same light makes the image brighter; with another masking, the lobe."""
    same = {name: getattr(Variant(), name) for name in changed}
    default, unchanged, other = (GS_IR.stage_of(GS_IR.variant(**each)).step()["shaded"] for each in ({}, same, changed))
    assert default == unchanged != other


def test_the_lengths_of_a_variant_are_multiplied_by_the_extent() -> None:
    """A tau of twice the lid's distance occludes the ball's top; one of half the distance leaves it open."""
    position = torch.tensor([[0.0, 0.0, 1.0]])

    def top(surfels: Surfels, tau: float) -> float:
        budget = replace(GS_IR.budget, occlusion_corners=24)
        stage = GS_IR.stage_of(GS_IR.variant(tau=tau / SCENE.extent), surfels, budget)
        assert stage.model.occlusion is not None
        return float(stage.model.occlusion.openness(position, position, 256))

    assert top(CAPPED, 0.8) < 0.3
    assert top(CAPPED, 0.2) > 0.8
