"""Stage 2 of SVG-IR: which parameters its losses change and which they do not, and that it resumes bit for bit."""

from dataclasses import replace

import pytest
import torch

from baselines.methods.stage_two import SVG_IR, UNSEEN, tensors_of
from known_ball import COLOUR, SCENE
from radiogs_baselines.methods.svg_ir.training import FROZEN
from radiogs_core.learning.views import load
from radiogs_core.transport.splatting import splat

MATERIALS = {"vertex_albedo_logit", "vertex_roughness_logit"}
LIGHT = {"log_environment", "ratio"}


def test_no_camera_sees_the_sheet() -> None:
    for view in load(SCENE.train, torch.device("cpu")):
        assert not splat(view.camera, UNSEEN, {}, 1.0).touched[-1]


def test_consistency_changes_unseen_materials_but_no_harmonics() -> None:
    stage = SVG_IR.stage_of(SVG_IR.variant(materials=SVG_IR.only(consistency=1.0)))
    before = tensors_of(stage)
    for _ in range(4):
        stage.step()
    after = tensors_of(stage)
    for name in MATERIALS:
        assert bool((after[name][-1] != before[name][-1]).any()), name
    assert {name for name in after if not torch.equal(after[name], before[name])} == MATERIALS | LIGHT


def test_image_losses_do_not_change_unseen_materials() -> None:
    stage = SVG_IR.stage_of(SVG_IR.variant(materials=SVG_IR.only(shaded=1.0)))
    before = tensors_of(stage)
    for _ in range(3):
        stage.step()
    after = tensors_of(stage)
    for name in ("vertex_albedo_logit", "vertex_roughness_logit", "vertex_offset"):
        assert torch.equal(after[name][-1], before[name][-1]), name
        assert not torch.equal(after[name], before[name]), name


def test_consistency_fits_the_albedo_to_the_radiance_of_the_table() -> None:
    """A sheet whose radiance in the table is 0.4, under a light of 1 whose rays reach it only from below."""
    learning = SVG_IR.only(consistency=1.0)
    still = replace(learning, rates=replace(learning.rates, light=0.0, ratio=0.0, roughness=0.0, albedo=0.1))
    stage = SVG_IR.stage_of(SVG_IR.variant(materials=still))
    state = stage.state()
    state["optimiser"]["tensors"] = state["optimiser"]["tensors"] | {"log_environment": torch.zeros(8, 16, 3)}
    stage.restore(state)
    first, last = stage.step()["consistency"], 0.0
    for _ in range(30):
        last = stage.step()["consistency"]
    assert last < 0.5 * first


@pytest.mark.parametrize(
    ("weight", "moved"),
    [
        ("shaded", MATERIALS | LIGHT | {"vertex_offset", "opacity_logit"}),
        ("radiance", {"sh", "sh_rest", "opacity_logit"}),
        ("consistency", MATERIALS | LIGHT),
        ("normal", {"vertex_offset", "opacity_logit"}),
        ("offset", {"vertex_offset"}),
        ("light_smoothness", {"log_environment"}),
    ],
)
def test_each_loss_changes_the_parameters_it_depends_on(weight: str, moved: set[str]) -> None:
    """The smoothness losses have their own test below, because the ball's materials are smooth."""
    stage = SVG_IR.stage_of(SVG_IR.variant(materials=SVG_IR.only(**{weight: 1.0})))
    state = stage.state()
    generator = torch.Generator().manual_seed(0)
    uneven = {
        name: 0.1 * torch.randn(state["optimiser"]["tensors"][name].shape, generator=generator)
        for name in ("log_environment", "vertex_offset")
    }
    state["optimiser"]["tensors"] = state["optimiser"]["tensors"] | uneven
    stage.restore(state)
    before = tensors_of(stage)
    stage.step()
    after = tensors_of(stage)
    assert {name for name, value in after.items() if not torch.equal(value, before[name])} == moved


@pytest.mark.parametrize("name", ["albedo", "roughness"])
def test_the_smoothness_loss_evens_out_a_material(name: str) -> None:
    raw, smooth = f"vertex_{name}_logit", SVG_IR.only(**{f"{name}_smoothness": 1.0})
    stage = SVG_IR.stage_of(
        SVG_IR.variant(materials=replace(smooth, rates=replace(smooth.rates, albedo=0.05, roughness=0.05)))
    )
    state = stage.state()
    uneven = torch.randn(state["optimiser"]["tensors"][raw].shape, generator=torch.Generator().manual_seed(1))
    state["optimiser"]["tensors"] = state["optimiser"]["tensors"] | {raw: uneven}
    stage.restore(state)
    losses = [stage.step()[f"{name} smoothness"] for _ in range(24)]
    assert sum(losses[-3:]) < 0.9 * sum(losses[:3]), "all three views, at the end and at the beginning"
    other = "vertex_roughness_logit" if name == "albedo" else "vertex_albedo_logit"
    assert torch.equal(tensors_of(stage)[other], tensors_of(SVG_IR.stage_of())[other])


def test_geometry_is_frozen_and_the_ratio_is_frozen_after_its_share() -> None:
    stage = SVG_IR.stage_of(SVG_IR.variant(), budget=replace(SVG_IR.budget, inverse_iterations=60))
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


def test_materials_are_recovered_under_known_light_and_shape() -> None:
    """Under a light of 1 the ball sends COLOUR, so its albedo is COLOUR minus the lobe for every initial value."""
    learning = SVG_IR.only(shaded=1.0)
    still = replace(learning, rates=replace(learning.rates, light=0.0, albedo=0.1, roughness=0.0, ratio=0.0))
    stage = SVG_IR.stage_of(
        SVG_IR.variant(materials=still, hop=1e-3), budget=replace(SVG_IR.budget, incident_samples=32)
    )
    state = stage.state()
    state["optimiser"]["tensors"] = state["optimiser"]["tensors"] | {"log_environment": torch.zeros(8, 16, 3)}
    stage.restore(state)
    for _ in range(60):
        stage.step()
    albedo = stage.model.albedo.detach().mean(1)
    seen = (albedo - 0.5).abs().sum(-1) > 0.3
    assert int(seen.sum()) > 50
    torch.testing.assert_close(albedo[seen].median(0).values, torch.tensor(COLOUR) - 0.03, rtol=0, atol=0.03)
