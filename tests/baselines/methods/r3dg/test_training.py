"""Stage 2 of R3DG: which parameters its losses change and which they do not, and that it resumes bit for bit."""

from dataclasses import replace

import pytest
import torch

from baselines.methods.irgs.world import DOWN, sheet, together
from baselines.methods.stage_two import R3DG, tensors_of, with_values
from known_ball import BALL, COLOUR, noise
from radiogs_baselines.methods.r3dg.model import before_softplus
from radiogs_baselines.methods.r3dg.training import InverseRendering

LEARNT = {"albedo_logit", "roughness_logit", "raw_environment", "local", "local_rest"}
ROOFED = together(BALL, sheet(3.0, DOWN, scale=0.5))
"""The ball, and above it a sheet that no camera sees; the sheet is the last surfel."""

Tensors = dict[str, torch.Tensor]


def changed(before: Tensors, after: Tensors) -> set[str]:
    return {name for name, value in after.items() if not torch.equal(value, before[name])}


def uneven(stage: InverseRendering) -> InverseRendering:
    """A stage whose light, local light and materials vary by position, so that every loss has a gradient."""
    tensors = tensors_of(stage)
    local = 0.3 + noise(tensors["local"], 0.2)
    rest = noise(tensors["local_rest"], 0.05)
    spread = {name: tensors[name] + noise(tensors[name], 0.5) for name in LEARNT - {"local", "local_rest"}}
    return with_values(stage, local=local, local_rest=rest, **spread)


@pytest.mark.parametrize(
    ("weight", "moved"),
    [
        ("absolute", LEARNT),
        ("similarity", LEARNT),
        ("albedo_smoothness", {"albedo_logit"}),
        ("roughness_smoothness", {"roughness_logit"}),
        ("irradiance_smoothness", {"raw_environment", "local", "local_rest"}),
        ("light_prior", {"raw_environment", "local", "local_rest"}),
        ("light_smoothness", {"raw_environment"}),
    ],
)
def test_each_loss_changes_the_parameters_it_depends_on(weight: str, moved: set[str]) -> None:
    stage = uneven(R3DG.stage_of(R3DG.variant(materials=R3DG.only(**{weight: 1.0}))))
    before = tensors_of(stage)
    for _ in range(2):
        stage.step()
    assert changed(before, tensors_of(stage)) == moved


def test_geometry_radiance_and_visibility_do_not_change() -> None:
    stage = R3DG.stage_of(surfels=ROOFED)
    before, table = tensors_of(stage), stage.table.state()
    for _ in range(6):
        stage.step()
    assert changed(before, tensors_of(stage)) == LEARNT
    assert all(torch.equal(value, table[name]) for name, value in stage.table.state().items())
    assert float(table["visibility"].min()) == 0, "the sheet shadows the ball's top"


def test_each_step_retraces_the_number_of_surfels_of_the_budget() -> None:
    stage = R3DG.stage_of(R3DG.variant(visibility="retraced"), ROOFED, replace(R3DG.budget, retraced_surfels=20))
    before = stage.table.state()["direction"]
    stage.step()
    turned = (stage.table.direction != before).any(-1).any(-1)
    assert int(turned.sum()) == 20
    height = (stage.table.direction * stage.table.normal[:, None]).sum(-1)
    torch.testing.assert_close(height, height[:1].expand_as(height), rtol=0, atol=1e-5)


@pytest.mark.parametrize(("mode", "moves"), [("free", True), ("gated", True), ("none", False)])
def test_local_light_is_learnt_from_zero(mode: str, moves: bool) -> None:
    """Gated local light is learnt as well, because the roof hides part of the sky."""
    stage = R3DG.stage_of(R3DG.variant(local_light=mode, materials=R3DG.only(absolute=1.0)), ROOFED)
    assert not tensors_of(stage)["local"].any()
    for _ in range(4):
        stage.step()
    assert {"local", "local_rest"} <= changed(tensors_of(R3DG.stage_of(surfels=ROOFED)), tensors_of(stage)) or not moves
    assert bool(tensors_of(stage)["local"].any()) == moves


def test_gated_local_light_of_an_unshadowed_surfel_is_not_learnt() -> None:
    stage = R3DG.stage_of(R3DG.variant(local_light="gated", materials=R3DG.only(absolute=1.0)), ROOFED)
    for _ in range(6):
        stage.step()
    free = (stage.table.visibility == 1).all(-1)
    assert bool(free.any())
    assert not tensors_of(stage)["local"][free].any()


def test_the_priors_reduce_coloured_and_uneven_local_light() -> None:
    """They penalise irradiance that differs between channels or neighbours."""
    colour = torch.tensor([0.5, 0.1, 0.1]).expand(len(BALL), 1, 3).clone()
    for weight in ("light_prior", "irradiance_smoothness"):
        local = colour if weight == "light_prior" else colour * (1 + noise(colour, 1.0)[..., :1].clamp(-1, 1))
        learning = R3DG.only(**{weight: 1.0})
        learning = replace(learning, rates=replace(learning.rates, light=0.0, local=0.005))
        stage = with_values(R3DG.stage_of(R3DG.variant(materials=learning)), local=local)
        name = weight.replace("_", " ")
        losses = [stage.step()[name] for _ in range(24)]
        assert sum(losses[-3:]) < 0.9 * sum(losses[:3]), weight


def test_the_neutrality_loss_includes_surfels_that_face_away() -> None:
    """The loss averages over all surfels for every view."""
    learning = R3DG.only(light_prior=1.0)
    colour = torch.tensor([0.5, 0.1, 0.1]).expand(len(BALL), 1, 3).clone()
    stage = with_values(R3DG.stage_of(R3DG.variant(materials=learning)), local=colour)
    before = tensors_of(stage)["local"]
    stage.step()
    assert bool((tensors_of(stage)["local"] != before).any(-1).all())


def test_the_rates_of_local_light_have_the_factor_of_the_budget() -> None:
    """Adam's first step equals the learning rate."""
    stage = R3DG.stage_of(budget=replace(R3DG.budget, local_rate=3.0))
    stage.step()
    after = tensors_of(stage)
    assert float(after["local"].abs().max()) == pytest.approx(3 * 0.001, rel=0.01)
    assert float(after["local_rest"].abs().max()) == pytest.approx(3 * 0.0001, rel=0.01)


def test_materials_are_recovered_under_known_light_and_shape() -> None:
    """Under a light of 1 the ball sends COLOUR, so its albedo is COLOUR minus the lobe for every initial value."""
    still = replace(R3DG.constant, rates=replace(R3DG.constant.rates, light=0.0, albedo=0.1, roughness=0.0))
    stage = R3DG.stage_of(
        R3DG.variant(materials=still, local_light="none"), budget=replace(R3DG.budget, incident_samples=64)
    )
    stage = with_values(stage, raw_environment=before_softplus(torch.ones(8, 16, 3)))
    for _ in range(60):
        stage.step()
    surfels = stage.model.surfels
    seen = (surfels.albedo - 0.415).abs().sum(-1) > 1e-3
    found = surfels.albedo[seen].median(0).values
    torch.testing.assert_close(found, torch.tensor(COLOUR) - 0.03, rtol=0, atol=0.02)
