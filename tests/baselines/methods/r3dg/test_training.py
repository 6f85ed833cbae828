"""Stage 2 of R3DG, beside the properties of all methods that ``test_stage_two`` tests."""

import pytest
import torch

from baselines.methods.irgs.world import DOWN, sheet, together
from baselines.methods.stage_two import R3DG, changed_by, stepped, tensors_of, with_values
from known_ball import BALL, noise

LEARNT = {"albedo_logit", "roughness_logit", "raw_environment", "local", "local_rest"}
ROOFED = together(BALL, sheet(3.0, DOWN, scale=0.5))
"""The ball, and above it a sheet that no camera sees; the sheet is the last surfel."""


def test_geometry_radiance_and_visibility_do_not_change() -> None:
    stage = R3DG.stage_of(surfels=ROOFED)
    table = stage.table.state()
    assert changed_by(stage, 6) == LEARNT
    assert all(torch.equal(value, table[name]) for name, value in stage.table.state().items())
    assert float(table["visibility"].min()) == 0, "the sheet shadows the ball's top"


def test_each_step_retraces_the_number_of_surfels_of_the_budget() -> None:
    stage = R3DG.stage_of(R3DG.variant(visibility="retraced"), ROOFED, R3DG.numbered(retraced_surfels=20))
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
    before, after = stepped(stage, 4)
    for name in ("local", "local_rest"):
        assert not before[name].any()
        assert bool(after[name].any()) == moves


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
        learning = R3DG.only({"light": 0.0, "local": 0.005}, **{weight: 1.0})
        stage = with_values(R3DG.stage_of(R3DG.variant(materials=learning)), local=local)
        name = weight.replace("_", " ")
        losses = [stage.step()[name] for _ in range(24)]
        assert sum(losses[-3:]) < 0.9 * sum(losses[:3]), weight


def test_the_neutrality_loss_includes_surfels_that_face_away() -> None:
    """The loss averages over all surfels for every view."""
    colour = torch.tensor([0.5, 0.1, 0.1]).expand(len(BALL), 1, 3).clone()
    stage = R3DG.stage_of(R3DG.variant(materials=R3DG.only(light_prior=1.0)))
    before, after = stepped(with_values(stage, local=colour))
    assert bool((after["local"] != before["local"]).any(-1).all())


def test_the_rates_of_local_light_have_the_factor_of_the_budget() -> None:
    """Adam's first step equals the learning rate."""
    stage = R3DG.stage_of(budget=R3DG.numbered(local_rate=3.0))
    _, after = stepped(stage)
    assert float(after["local"].abs().max()) == pytest.approx(3 * 0.001, rel=0.01)
    assert float(after["local_rest"].abs().max()) == pytest.approx(3 * 0.0001, rel=0.01)
