"""Maps of surfels where there are none."""

import torch

from radiogs_core.transport.splatting import splat
from scenes import sphere_scene, surfels_facing


def test_depth_is_zero_where_nothing_is_seen_and_so_is_its_gradient() -> None:
    camera = sphere_scene().test[0].camera
    surfels = surfels_facing(torch.zeros(4, 3), torch.nn.functional.normalize(camera.centre.expand(4, 3), dim=-1))
    surfels.centre.requires_grad_()
    seen = splat(camera, surfels, {"any": torch.zeros(4, 1)}, depth_unit=1.0)
    empty = seen.alpha == 0
    assert bool(empty.any())
    assert not bool(seen.depth[empty].any())
    seen.depth.sum().backward()
    assert surfels.centre.grad is not None
    assert bool(surfels.centre.grad.isfinite().all())
    assert bool(surfels.centre.grad.any())
