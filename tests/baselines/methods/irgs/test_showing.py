"""A trained IRGS model, beside the properties of all methods that ``test_trained`` tests."""

import pytest
import torch

from baselines.methods.irgs.world import DOWN, grey, sheet, together
from baselines.methods.stage_two import IRGS
from baselines.methods.trained_models import irgs as trained
from known_ball import BALL, SCENE
from radiogs_baselines.methods.irgs.method import IRGS_METHOD
from radiogs_core.on_surfels.model import LitSurfels as Model

CAMERA = SCENE.test[0].camera


def test_the_albedo_scale_applies_to_hits_only_if_scaled() -> None:
    """The roof is hit by rays."""
    twice = torch.full((3,), 2.0)
    plain = trained().prepare(grey()).render(CAMERA)
    seen = trained().prepare(grey(), twice).render(CAMERA)
    both = trained(IRGS.variant(secondary_albedo="scaled")).prepare(grey(), twice).render(CAMERA)
    lit = plain["indirect"].amax(-1) > 0.01
    assert bool(lit.any())
    torch.testing.assert_close(seen["direct"], both["direct"], rtol=0, atol=0)
    assert bool((both["indirect"][lit] > 1.2 * seen["indirect"][lit]).all())


@pytest.mark.parametrize(("start", "expected"), [(None, 0.0), (1e3, 1.0)])
def test_rays_hit_only_surfels_beyond_their_start(start: float | None, expected: float) -> None:
    """A roof over the ball; a little light from below its edge reaches the ball's sides."""
    roof = together(BALL, sheet(2.9, DOWN, scale=1e3))
    found = IRGS_METHOD.restore(
        IRGS.run_of(IRGS.variant(ray_start=start)), Model(roof, torch.zeros(8, 16, 3)).tensors()
    )
    maps = found.prepare().render(CAMERA)
    free = IRGS_METHOD.restore(IRGS.run_of(), Model(BALL, torch.zeros(8, 16, 3)).tensors()).prepare().render(CAMERA)
    up = maps["normal"][..., 2] > 0.8
    ratio = float(maps["direct"][up].mean() / free["direct"][up].mean())
    assert ratio == pytest.approx(expected, abs=0.1)
