"""Stage 2 of SVG-IR, beside the properties of all methods that ``test_stage_two`` tests."""

import torch

from baselines.methods.stage_two import SVG_IR, UNSEEN, stepped, tensors_of, with_values
from radiogs_baselines.methods.svg_ir.training import FROZEN

MATERIALS = {"vertex_albedo_logit", "vertex_roughness_logit"}
LIGHT = {"log_environment", "ratio"}


def test_consistency_changes_unseen_materials_but_no_harmonics() -> None:
    stage = SVG_IR.stage_of(SVG_IR.variant(materials=SVG_IR.only(consistency=1.0)))
    before, after = stepped(stage, 4)
    for name in MATERIALS:
        assert bool((after[name][-1] != before[name][-1]).any()), name
    assert {name for name in after if not torch.equal(after[name], before[name])} == MATERIALS | LIGHT


def test_image_losses_do_not_change_unseen_materials() -> None:
    stage = SVG_IR.stage_of(SVG_IR.variant(materials=SVG_IR.only(shaded=1.0)))
    before, after = stepped(stage, 3)
    for name in ("vertex_albedo_logit", "vertex_roughness_logit", "vertex_offset"):
        assert torch.equal(after[name][-1], before[name][-1]), name
        assert not torch.equal(after[name], before[name]), name


def test_consistency_fits_the_albedo_to_the_radiance_of_the_table() -> None:
    """A sheet whose radiance in the table is 0.4, under a light of 1 whose rays reach it only from below."""
    still = SVG_IR.only({"light": 0.0, "ratio": 0.0, "roughness": 0.0, "albedo": 0.1}, consistency=1.0)
    stage = SVG_IR.stage_of(SVG_IR.variant(materials=still))
    with_values(stage, log_environment=torch.zeros(8, 16, 3))
    first, last = stage.step()["consistency"], 0.0
    for _ in range(30):
        last = stage.step()["consistency"]
    assert last < 0.5 * first


def test_geometry_is_frozen_and_the_ratio_is_frozen_after_its_share() -> None:
    stage = SVG_IR.stage_of(SVG_IR.variant(), budget=SVG_IR.numbered(inverse_iterations=60))
    start = tensors_of(stage)
    for _ in range(3):
        stage.step()
    held = tensors_of(stage)["ratio"]
    assert held != start["ratio"]
    for _ in range(3):
        stage.step()
    after = tensors_of(stage)
    assert torch.equal(after["ratio"], held)
    for name in FROZEN:
        assert torch.equal(after[name], start[name]), name
    for name in after.keys() - set(FROZEN):
        assert not torch.equal(after[name], start[name]), name


def test_without_indirect_light_only_consistency_changes_the_ratio() -> None:
    stage = SVG_IR.stage_of(SVG_IR.variant(indirect=False, materials=SVG_IR.only(shaded=1.0)))
    stage.step()
    assert float(tensors_of(stage)["ratio"]) == 1


def test_constant_attributes_have_one_vertex_per_surfel() -> None:
    stage = SVG_IR.stage_of(SVG_IR.variant(attributes="constant"))
    for _ in range(2):
        stage.step()
    assert stage.model.albedo.shape == (len(UNSEEN), 1, 3)
    assert SVG_IR.stage_of().model.albedo.shape == (len(UNSEEN), 4, 3)


def test_training_makes_the_vertices_of_a_surfel_differ() -> None:
    stage = SVG_IR.stage_of(SVG_IR.variant(materials=SVG_IR.only(shaded=1.0)))
    for _ in range(6):
        stage.step()
    albedo = stage.model.albedo.detach()
    assert float((albedo.amax(1) - albedo.amin(1)).max()) > 1e-3
