"""Stage 2 of IRGS, beside the properties of all methods that ``test_stage_two`` tests."""

from baselines.methods.irgs.world import DOWN, sheet, together
from baselines.methods.stage_two import IRGS, UNSEEN, stepped, tensors_of
from known_ball import BALL


def test_only_learnt_geometry_has_losses_of_its_own() -> None:
    """The loss of normals begins after five of 100 steps."""
    for scale, expected in ((0.0, set()), (0.5, {"mask", "normal", "normal smoothness"})):
        stage = IRGS.stage_of(IRGS.variant(lr_scale=scale))
        losses = [stage.step() for _ in range(6)][-1]
        assert {"mask", "normal", "normal smoothness"} & losses.keys() == expected


def test_training_dims_a_sheet_whose_radiance_is_too_bright() -> None:
    """The images are of a ball in a light of 1; the sheet's excess light acts through L_ind only."""
    bright = together(BALL, sheet(3.0, DOWN, scale=0.5, radiance=20.0))
    stage = IRGS.stage_of(IRGS.variant(materials=IRGS.only(shaded=1.0)), bright)
    for _ in range(10):
        stage.step()
    assert (tensors_of(stage)["sh"][-1] < bright.sh[-1, 0]).all()


def test_learnt_geometry_includes_surfels_that_no_camera_sees() -> None:
    """The sheet over the ball acts through visibility and L_ind, traced with its current geometry."""
    stage = IRGS.stage_of(IRGS.variant(lr_scale=1.0, materials=IRGS.only(shaded=1.0)), UNSEEN)
    before, after = stepped(stage, 3)
    for name in ("centre", "opacity_logit"):
        assert bool((after[name][-1] != before[name][-1]).any()), name


def test_pixels_are_drawn_from_the_whole_image() -> None:
    """Eight pixels a step: within twelve steps the ball's top and bottom are both shaded."""
    stage = IRGS.stage_of(IRGS.variant(materials=IRGS.only(shaded=1.0)), budget=IRGS.numbered(pixels=8))
    before = tensors_of(stage)["albedo_logit"]
    for _ in range(12):
        stage.step()
    shaded = (tensors_of(stage)["albedo_logit"] != before).any(-1)
    height = BALL.centre[:, 2]
    assert bool(shaded[height > 0.5].any())
    assert bool(shaded[height < -0.5].any())
