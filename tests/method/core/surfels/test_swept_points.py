import dataclasses

import pytest
import torch
from scipy.spatial import cKDTree

from radiogs_core.surfels.starting_points import SurfelStart, initial_surfels, view_radius
from radiogs_core.surfels.swept_depth import DepthSweep, SmallView
from radiogs_core.surfels.swept_points import fused, offsets, spread, swept_points
from radiogs_datasets import load_scene
from scenes import sphere_scene

SMALL = DepthSweep(side=32, planes=32, neighbours=4, agreeing=2)
SWEPT, HULL = SurfelStart(points="swept", sweep=SMALL), SurfelStart(points="hull")


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_surfels_start_on_a_sphere_and_face_outwards_at_any_scale_of_the_world(scale: float) -> None:
    scene = sphere_scene(views=16, size=32, scale=scale)
    surfels = initial_surfels(scene, scene.train, 300, SWEPT, False, torch.Generator().manual_seed(0))
    assert len(surfels) == 300
    radius = surfels.centre.norm(dim=-1) / scale
    assert float((radius - 1).abs().median()) < 0.05
    outwards = torch.nn.functional.normalize(surfels.centre, dim=-1)
    assert float((surfels.frame[..., 2] * outwards).sum(-1).median()) > 0.9
    assert float(surfels.opacity.mean()) == pytest.approx(SMALL.opacity)
    hull = initial_surfels(scene, scene.train, 300, HULL, False, torch.Generator().manual_seed(0))
    assert float((hull.centre.norm(dim=-1) / scale - 1).abs().median()) > 0.1


def test_offsets_are_negative_in_free_space_and_zero_for_unseen_points() -> None:
    scene = sphere_scene(views=8, size=32)
    views = [SmallView.of(view, 32) for view in scene.train]
    tolerance = 0.1
    depths = []
    for view in views:  # each sees the plane through the centre that faces it
        depths.append(torch.where(view.covered, view.camera.depth_of(torch.zeros(3)), 0.0))
    to_first = torch.nn.functional.normalize(views[0].camera.centre, dim=0)
    points = torch.stack([to_first * 0.05, to_first * 0.5, -to_first * 0.5, torch.tensor([0.0, 0.0, 9.0])])
    only = offsets(points, views[:1], depths[:1], tolerance)
    torch.testing.assert_close(only, torch.tensor([-0.5, -1.0, 0.0, 0.0]), atol=1e-4, rtol=0)
    # The last view looks from half-way behind: for it the second point is behind the plane, unseen.
    behind = offsets(points[1:2], [views[0], views[4]], [depths[0], depths[4]], tolerance)
    assert float(behind) == pytest.approx(-1.0)


def test_fused_points_lie_where_the_depths_of_all_views_are_on_average() -> None:
    """Views whose depths differ by a thirtieth: all points end on the sphere between them, wherever they began."""
    scene = sphere_scene(views=24, size=64)
    views = [SmallView.of(view, 64) for view in scene.train]
    radii = [1 + (0.03 if place % 2 else -0.03) for place in range(24)]
    depths = [_depth_of_a_sphere(view, radius) for view, radius in zip(views, radii, strict=True)]
    outwards = torch.nn.functional.normalize(torch.randn(500, 3, generator=torch.Generator().manual_seed(0)), dim=-1)
    centres = torch.stack([view.camera.centre for view in views])
    facing = (outwards @ torch.nn.functional.normalize(centres, dim=-1).T > 0.5).sum(1)
    outwards = outwards[facing >= 4]
    assert len(outwards) > 200
    for begun in (0.96, 1.04):
        ended = fused(begun * outwards, outwards, views, depths, tolerance=0.2, fusions=4).norm(dim=-1)
        assert float((ended - 1).abs().median()) < 0.005
        assert float((ended - 1).abs().quantile(0.9)) < 0.02
    unseen = torch.tensor([[0.0, 0.0, 9.0]])
    assert torch.equal(fused(unseen, outwards[:1], views, depths, tolerance=0.2, fusions=4), unseen)
    assert torch.equal(fused(outwards, outwards, views, depths, tolerance=0.2, fusions=0), outwards)
    far = 1.3 * outwards
    assert torch.equal(fused(far, outwards, views, depths, tolerance=0.1, fusions=4), far)


def _depth_of_a_sphere(view: SmallView, radius: float) -> torch.Tensor:
    """Depth of the sphere about the origin; 0 beside it."""
    direction, centre = view.camera.ray_directions(), view.camera.centre
    a, b = direction.square().sum(-1), direction @ centre
    under = b.square() - a * (centre.square().sum() - radius**2)
    return torch.where(view.covered & (under > 0), (-b - under.clamp(min=0).sqrt()) / a, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["occluder", "wire"])
def test_hardly_a_point_starts_beside_thin_things(name: str) -> None:
    """Plain floor below bars and plates looks alike at many depths: few near views agree on wrong depths."""
    scene = load_scene(name)
    surface = scene.true_surfaces(0.01 * scene.extent).centre.double()
    points, _, _ = swept_points(
        scene, scene.train, view_radius(scene), 3000, DepthSweep(), torch.Generator().manual_seed(0)
    )
    far = cKDTree(surface.numpy()).query(points.double().numpy())[0] > 0.02 * scene.extent
    assert far.mean() < 0.06


def test_points_are_spread_over_the_world_and_not_over_pixels() -> None:
    generator = torch.Generator().manual_seed(0)
    dense, sparse = torch.rand(9000, 3, generator=generator), torch.rand(1000, 3, generator=generator)
    points = torch.cat([dense * torch.tensor([1.0, 1.0, 0]), sparse * torch.tensor([1.0, 1.0, 0]) + 2])
    chosen = spread(points, 500, 5.0, generator)
    assert len(chosen) == len(chosen.unique()) == 500
    assert 0.3 < float((chosen >= 9000).float().mean()) < 0.7  # half of the area, a tenth of the points
    assert len(spread(points[:7], 500, 5.0, generator)) == 7
    assert len(spread(points[:1].repeat(50, 1), 500, 5.0, generator)) == 1


def test_surfels_start_in_the_hull_where_no_views_agree_on_a_surface() -> None:
    scene = sphere_scene(views=8, size=32)
    none = SurfelStart(points="swept", sweep=dataclasses.replace(SMALL, freest=2.0))
    surfels = initial_surfels(scene, scene.train, 50, none, True, torch.Generator().manual_seed(0))
    plain = initial_surfels(scene, scene.train, 50, HULL, True, torch.Generator().manual_seed(0))
    assert torch.equal(surfels.centre, plain.centre)
    assert torch.equal(surfels.opacity_logit, plain.opacity_logit)
