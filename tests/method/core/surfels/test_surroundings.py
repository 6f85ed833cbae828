"""Where surfels start in a scene without masks: sparse points, and pixels' rays out to almost infinity."""

from dataclasses import replace

import pytest
import torch

from radiogs_core.scene.contraction import Contraction
from radiogs_core.scene.scene import Points, Scene
from radiogs_core.surfels.starting_points import SurfelStart
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.surfels.surroundings import (
    SurroundingsStart,
    depth_range,
    disagreement,
    nearest_views,
    pixel_width,
    points_on_rays,
    starting_scale,
    surrounded_surfels,
    visible_points,
)
from rooms import DISTANCE, room_scene, seen_points

AROUND, ONE = SurroundingsStart(), SurroundingsStart(candidates=1)


def seed() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def started(scene: Scene, count: int) -> Surfels:
    return surrounded_surfels(scene, scene.train, count, SurfelStart(), AROUND, False, seed())


def test_points_lie_on_rays_of_pixels_and_have_their_colours() -> None:
    scene = room_scene(size=16)
    found = points_on_rays(scene, scene.train, 300, AROUND, seed())
    explained = torch.zeros(300, dtype=torch.bool)
    for view in scene.train:
        pixel, depth, _ = view.camera.project(found.positions)
        at_centre = ((pixel - pixel.floor() - 0.5).abs() < 1e-3).all(-1) & (depth > 0)
        column, row = pixel.long().clamp(0, 15).unbind(-1)
        explained |= at_centre & (view.read("image")[row, column] - found.colours).abs().amax(-1).lt(1e-6)
    assert explained.all()


def test_without_a_choice_depths_are_uniform_in_disparity() -> None:
    scene = room_scene(views=2, size=16)  # one training view
    found = points_on_rays(scene, scene.train, 4000, ONE, seed())
    _, depth, _ = scene.train[0].camera.project(found.positions)
    nearest, farthest = depth_range(scene, scene.train[0], ONE)
    share = (1 / depth - 1 / farthest) / (1 / nearest - 1 / farthest)
    torch.testing.assert_close(share.sort().values, torch.linspace(0, 1, 4000), atol=0.03, rtol=0)


def test_the_depth_is_chosen_at_which_views_agree() -> None:
    scene, error = room_scene(views=32, size=32), {}
    surface = torch.cat([seen_points(view).flatten(0, 1) for view in scene.train])
    space = Contraction.of(scene)
    for around in (ONE, AROUND):
        positions = points_on_rays(scene, scene.train, 1000, around, seed()).positions
        apart = torch.cdist(space.contracted(positions), space.contracted(surface)).amin(1)
        error[around.candidates] = float(apart.median())
    assert error[8] < 0.75 * error[1]


def test_views_of_the_nearest_cameras_are_compared_where_they_show_the_point() -> None:
    scene = room_scene(views=32, size=64)
    view, *others = scene.train
    near = nearest_views(view, scene.train, 3)
    apart = sorted(float((other.camera.centre - view.camera.centre).norm()) for other in others)
    assert [float((other.camera.centre - view.camera.centre).norm()) for other in near] == pytest.approx(apart[:3])
    behind = (view.camera.centre - 50 * view.camera.axes[:, 2]).view(1, 1, 3)
    shown = seen_points(view)[4, 32].view(1, 1, 3)
    colour = view.read("image")[4, 32][None]
    found = disagreement(torch.cat([behind, shown, 0.3 * shown], 1), colour, near)[0]
    assert found[0] == torch.inf
    assert found[1] < 0.01 < found[2]


def test_sparse_points_come_first_with_their_colours_up_to_their_share() -> None:
    scene = room_scene(size=16, points=40)
    assert scene.points is not None
    surfels = started(scene, 100)
    assert len(surfels) == 100
    assert len(visible_points(scene, scene.train, 1000, seed()).positions) == 40
    few = visible_points(scene, scene.train, 50 // 2, seed())
    torch.testing.assert_close(started(scene, 50).centre[:25], few.positions)
    nearest = torch.cdist(surfels.centre[:40], scene.points.positions).argmin(1)
    torch.testing.assert_close(0.5 + 0.28209479 * surfels.sh[:40, 0], scene.points.colours[nearest])


def test_sparse_points_that_no_view_shows_are_left_out() -> None:
    scene = room_scene(size=16)
    unseen = Points(torch.tensor([[0.0, 0.0, 500.0], [0.0, 0.0, 0.0]]), torch.rand(2, 3))
    found = visible_points(replace(scene, points=unseen), scene.train, 10, seed())
    assert found.positions.tolist() == [[0.0, 0.0, 0.0]]


def test_nothing_starts_nearer_than_the_sparse_points_of_a_view() -> None:
    scene = room_scene(size=16, points=400)
    bare = depth_range(replace(scene, points=None), scene.train[0], AROUND)
    nearest, farthest = depth_range(scene, scene.train[0], AROUND)
    assert nearest > DISTANCE - 0.5  # the ball's front
    assert bare[0] == pytest.approx(0.5 * DISTANCE, rel=0.2)
    assert farthest == bare[1]


def test_starting_scales_are_bounded_from_both_sides_by_pixels_and_robust_to_outliers() -> None:
    scene = room_scene(size=32)
    generator = seed()
    ball = torch.randn(500, 3, generator=generator) * 0.3
    view = scene.train[0]
    far = view.camera.centre + 300 * view.camera.axes[:, 2]
    points = torch.cat([ball, ball[:50], far[None]])  # doubled ones, and one that is alone, far away
    scale, width = starting_scale(points, scene.train, Contraction.of(scene), AROUND), pixel_width(points, scene.train)
    pixels = scale / width
    assert float(pixels.min()) == pytest.approx(AROUND.least_pixels)
    assert float(pixels[-1]) == pytest.approx(float(pixels.max()))
    assert float(pixels.max()) < 3 * float(pixels.median())


@pytest.mark.parametrize("scale", [1e-2, 1e2])
def test_the_start_does_not_depend_on_the_unit_of_length(scale: float) -> None:
    scene = room_scene(size=16, points=40)
    assert scene.points is not None

    def enlarged(view):  # type: ignore[no-untyped-def]
        matrix = view.camera.camera_to_world.clone()
        matrix[:3, 3] *= scale
        return replace(view, camera=replace(view.camera, camera_to_world=matrix))

    sparse = replace(scene.points, positions=scale * scene.points.positions)
    large = replace(scene, train=tuple(map(enlarged, scene.train)), points=sparse)
    small, big = started(scene, 200), started(large, 200)
    torch.testing.assert_close(big.centre, scale * small.centre, rtol=1e-3, atol=1e-4 * scale)
    torch.testing.assert_close(big.scale, scale * small.scale, rtol=1e-3, atol=1e-5 * scale)
