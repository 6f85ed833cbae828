"""Stage 2 of IRGS: which parameters its losses change and which they do not, and that it resumes bit for bit."""

from dataclasses import replace

import pytest
import torch

from baselines.methods.irgs.world import DOWN, sheet, together
from baselines.methods.stage_two import GEOMETRY, IRGS, tensors_of
from known_ball import BALL, COLOUR, SCENE, noise
from radiogs_baselines.methods.irgs.settings import Indirect, Variant
from radiogs_core.learning.views import load
from radiogs_core.transport.splatting import splat

UNSEEN = together(BALL, sheet(3.0, DOWN, scale=0.5, radiance=0.4))
"""The ball, and above it a sheet with radiance towards it; the sheet is the last surfel."""


def test_no_camera_sees_the_sheet() -> None:
    for view in load(SCENE.train, torch.device("cpu")):
        assert not splat(view.camera, UNSEEN, {}, 1.0).touched[-1]


@pytest.mark.parametrize(("indirect", "changes"), [("traced", True), ("detached", False), ("none", False)])
def test_the_image_loss_changes_harmonics_of_unseen_surfels(indirect: Indirect, changes: bool) -> None:
    stage = IRGS.stage_of(IRGS.variant(indirect=indirect, materials=IRGS.only(shaded=1.0)), UNSEEN)
    before = tensors_of(stage)
    for _ in range(4):
        stage.step()
    after = tensors_of(stage)
    for name in ("sh", "sh_rest"):
        assert bool((after[name][-1] != before[name][-1]).any()) == changes, name
    assert (after["albedo_logit"] != before["albedo_logit"]).any(), "pixels were shaded"
    assert torch.equal(after["albedo_logit"][-1], before["albedo_logit"][-1]), "nothing ties its material to an image"


def test_training_dims_a_sheet_whose_radiance_is_too_bright() -> None:
    """The images are of a ball in a light of 1; the sheet's excess light acts through L_ind only."""
    bright = together(BALL, sheet(3.0, DOWN, scale=0.5, radiance=20.0))
    stage = IRGS.stage_of(IRGS.variant(materials=IRGS.only(shaded=1.0)), bright)
    for _ in range(10):
        stage.step()
    assert (tensors_of(stage)["sh"][-1] < bright.sh[-1, 0]).all()


@pytest.mark.parametrize("scale", [0.0, 0.5])
def test_geometry_is_frozen_without_a_rate(scale: float) -> None:
    stage = IRGS.stage_of(IRGS.variant(lr_scale=scale))
    before = tensors_of(stage)
    losses = [stage.step() for _ in range(6)][-1]
    after = tensors_of(stage)
    for name in GEOMETRY:
        assert torch.equal(after[name], before[name]) == (scale == 0), name
    assert {"mask", "normal", "normal smoothness"} <= losses.keys() if scale else "normal" not in losses
    for name in ("sh", "albedo_logit", "roughness_logit", "log_environment"):
        assert not torch.equal(after[name], before[name]), name


def test_learnt_geometry_includes_surfels_that_no_camera_sees() -> None:
    """The sheet over the ball acts through visibility and L_ind, traced with its current geometry."""
    stage = IRGS.stage_of(IRGS.variant(lr_scale=1.0, materials=IRGS.only(shaded=1.0)), UNSEEN)
    before = tensors_of(stage)
    for _ in range(3):
        stage.step()
    after = tensors_of(stage)
    for name in ("centre", "opacity_logit"):
        assert bool((after[name][-1] != before[name][-1]).any()), name


def test_geometry_moves_at_its_share_of_the_rates_of_stage_one() -> None:
    stage = IRGS.stage_of(IRGS.variant(lr_scale=0.25))
    before, first = tensors_of(stage), Variant().geometry.rates
    stage.step()
    moved = (tensors_of(stage)["centre"] - before["centre"]).abs().max()
    # Adam's first step is the rate itself.
    torch.testing.assert_close(float(moved), 0.25 * first.position * SCENE.extent, rtol=0.01, atol=0)


@pytest.mark.parametrize(
    ("weight", "moved"),
    [
        ("shaded", {"albedo_logit", "roughness_logit", "sh", "sh_rest", "log_environment"}),
        ("absolute", {"sh", "sh_rest"}),
        ("similarity", {"sh", "sh_rest"}),
        ("light_prior", {"log_environment"}),
        ("light_smoothness", {"log_environment"}),
    ],
)
def test_each_loss_changes_the_parameters_it_depends_on(weight: str, moved: set[str]) -> None:
    """The smoothness losses have their own test below, because the ball's materials are smooth."""
    stage = IRGS.stage_of(IRGS.variant(materials=IRGS.only(**{weight: 1.0})), UNSEEN)
    light = {"log_environment": 0.3 * torch.randn(8, 16, 3, generator=torch.Generator().manual_seed(0))}
    state = stage.state()
    state["optimiser"]["tensors"] = state["optimiser"]["tensors"] | light
    stage.restore(state)
    before = tensors_of(stage)
    stage.step()
    after = tensors_of(stage)
    assert {name for name, value in after.items() if not torch.equal(value, before[name])} == moved


@pytest.mark.slow
@pytest.mark.parametrize("name", ["albedo", "roughness"])
def test_the_smoothness_loss_evens_out_a_material(name: str) -> None:
    raw = f"{name}_logit"
    uneven = getattr(BALL, raw) + noise(getattr(BALL, raw), 1.0)
    smooth = IRGS.only(**{f"{name}_smoothness": 1.0})
    stage = IRGS.stage_of(
        IRGS.variant(materials=replace(smooth, rates=replace(smooth.rates, albedo=0.05, roughness=0.05)))
    )
    state = stage.state()
    state["optimiser"]["tensors"] = state["optimiser"]["tensors"] | {raw: uneven}
    stage.restore(state)
    losses = [stage.step()[f"{name} smoothness"] for _ in range(30)]
    assert sum(losses[-3:]) < 0.9 * sum(losses[:3]), "all three views, at the end and at the beginning"
    after = tensors_of(stage)
    other = "roughness_logit" if name == "albedo" else "albedo_logit"
    assert torch.equal(after[other], getattr(IRGS.stage_of().model.surfels, other))


def test_pixels_are_drawn_from_the_whole_image() -> None:
    """Eight pixels a step: within twelve steps the ball's top and bottom are both shaded."""
    stage = IRGS.stage_of(IRGS.variant(materials=IRGS.only(shaded=1.0)), budget=replace(IRGS.budget, pixels=8))
    before = tensors_of(stage)["albedo_logit"]
    for _ in range(12):
        stage.step()
    shaded = (tensors_of(stage)["albedo_logit"] != before).any(-1)
    height = BALL.centre[:, 2]
    assert bool(shaded[height > 0.5].any())
    assert bool(shaded[height < -0.5].any())


@pytest.mark.slow
def test_materials_are_recovered_under_known_light_and_shape() -> None:
    """Under a light of 1 the ball sends COLOUR, so its albedo is COLOUR minus the lobe for every initial value."""
    still = replace(IRGS.constant, rates=replace(IRGS.constant.rates, light=0.0, albedo=0.05, roughness=0.0))
    stage = IRGS.stage_of(IRGS.variant(materials=still), budget=replace(IRGS.budget, pixels=256, incident_samples=64))
    state = stage.state()
    state["optimiser"]["tensors"] = state["optimiser"]["tensors"] | {"log_environment": torch.zeros(8, 16, 3)}
    stage.restore(state)
    for _ in range(60):
        stage.step()
    surfels = stage.model.surfels
    seen = (surfels.albedo - 0.3).abs().sum(-1) > 1e-3
    found = surfels.albedo[seen].median(0).values
    torch.testing.assert_close(found, torch.tensor(COLOUR) - 0.03, rtol=0, atol=0.02)
