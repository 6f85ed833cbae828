"""How much of the training images each surfel makes up."""

import pytest
import torch

from radiogs_core.learning.views import load
from radiogs_core.on_surfels.fit_geometry import largest_contribution
from radiogs_core.surfels.surfels import inverse_sigmoid
from radiogs_core.transport.blending_weights import blending_weights
from radiogs_core.transport.splatting import splat
from scenes import look_at, sphere_scene, surfels_facing

CPU = torch.device("cpu")


def test_a_large_image_is_looked_at_through_fewer_pixels_that_count_for_more(monkeypatch: pytest.MonkeyPatch) -> None:
    generator = torch.Generator().manual_seed(1)
    centres = 0.5 * torch.randn(40, 3, generator=generator)
    surfels = surfels_facing(centres, torch.tensor([1.0, 0.0, 0.0]).expand(40, 3).contiguous())
    surfels.log_scale = torch.full_like(surfels.log_scale, -2.0)
    camera = look_at(torch.tensor([4.0, 0.0, 0.0]), torch.zeros(3), 102, 100.0)
    whole = blending_weights(camera, surfels)
    monkeypatch.setattr("radiogs_core.transport.blending_weights.MOST_PIXELS", 102 * 102 // 3)
    coarse = blending_weights(camera, surfels)
    assert float((coarse - whole).abs().max()) > 0, "of fewer pixels"
    torch.testing.assert_close(coarse.sum(), whole.sum(), rtol=0.01, atol=0)
    torch.testing.assert_close(coarse, whole, rtol=0.1, atol=3.0)


def test_contributions_are_sums_of_blending_weights_in_the_view_that_shows_most() -> None:
    scene = sphere_scene(views=3)
    views = load(scene.train, CPU)
    middle = scene.centre.float()
    towards = torch.nn.functional.normalize(views[0].camera.centre - middle, dim=-1)
    centres = torch.stack([middle, middle - 0.3 * towards, middle - 50 * towards])
    surfels = surfels_facing(centres, towards.expand(3, 3).contiguous())
    surfels.log_scale = torch.full_like(surfels.log_scale, -1.0)
    surfels.opacity_logit = torch.tensor([0.9, 0.9, 0.9]).apply_(inverse_sigmoid)
    found = largest_contribution(surfels, views)
    alone = largest_contribution(surfels.take(torch.tensor([1])), views)
    coverage = torch.stack([splat(view.camera, surfels, {}, 1.0).alpha.sum() for view in views])
    assert float(found[0]) > 1
    assert 0 < float(found[1]) < float(alone[0])
    assert float(coverage.max()) <= float(found.sum()) * (1 + 1e-5)
    first = largest_contribution(surfels, views[:1])
    torch.testing.assert_close(first.sum(), coverage[0])
    torch.testing.assert_close(torch.stack([largest_contribution(surfels, (each,)) for each in views]).amax(0), found)
