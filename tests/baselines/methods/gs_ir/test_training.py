"""Stage 2 of GS-IR, beside the properties of all methods that ``test_stage_two`` tests."""

import pytest
import torch

from baselines.methods.stage_two import CAPPED, GS_IR, stepped, with_values
from known_ball import SCENE
from radiogs_baselines.methods.gs_ir.settings import Variant
from radiogs_baselines.methods.gs_ir.shading import View
from radiogs_core.surfels.surfels import Surfels

WIDE = 0.8 / SCENE.extent
"""A tau of twice the lid's distance, in extents."""


@pytest.mark.parametrize(
    ("turned", "lacks"), [({"occlusion": False}, {"irradiance"}), ({"indirect": False}, {"irradiance"}), ({}, set())]
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
    stage = GS_IR.stage_of(GS_IR.variant(tau=WIDE), CAPPED, GS_IR.numbered(occlusion_corners=24))
    open_ball = GS_IR.stage_of(GS_IR.variant(tau=WIDE), budget=GS_IR.numbered(occlusion_corners=24))
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
    stage = GS_IR.stage_of(GS_IR.variant(metallic=True, materials=GS_IR.only(prior=1.0)))
    before, after = stepped(stage, 3)
    seen = after["roughness_logit"] != before["roughness_logit"]
    assert bool(seen.any())
    assert bool((after["roughness_logit"] >= before["roughness_logit"]).all())
    assert bool((after["metallic_logit"] <= before["metallic_logit"]).all())


def test_irradiance_is_learnt_where_the_light_is_occluded() -> None:
    """The images show the ball in a constant light of 1, also under the lid: there the volume has to add the light."""
    still = GS_IR.learning({"light": 0.0, "albedo": 0.0, "roughness": 0.0})
    chosen = GS_IR.variant(tau=WIDE, lr_scale=0.0, materials=still)
    stage = GS_IR.stage_of(chosen, CAPPED, GS_IR.numbered(occlusion_corners=24, irradiance_corners=12))
    with_values(stage, log_environment=torch.zeros(8, 16, 3), albedo_logit=CAPPED.albedo_logit)

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
def test_training_filters_and_reflects_the_light_by_the_variant(changed: dict[str, str]) -> None:
    """With approximate areas the same light makes the image brighter; with another masking, the lobe."""
    same = {name: getattr(Variant(), name) for name in changed}
    default, unchanged, other = (GS_IR.stage_of(GS_IR.variant(**each)).step()["shaded"] for each in ({}, same, changed))
    assert default == unchanged != other


def test_the_lengths_of_a_variant_are_multiplied_by_the_extent() -> None:
    """A tau of twice the lid's distance occludes the ball's top; one of half the distance leaves it open."""
    position = torch.tensor([[0.0, 0.0, 1.0]])

    def top(surfels: Surfels, tau: float) -> float:
        budget = GS_IR.numbered(occlusion_corners=24)
        stage = GS_IR.stage_of(GS_IR.variant(tau=tau / SCENE.extent), surfels, budget)
        assert stage.model.occlusion is not None
        return float(stage.model.occlusion.openness(position, position, 256))

    assert top(CAPPED, 0.8) < 0.3
    assert top(CAPPED, 0.2) > 0.8
