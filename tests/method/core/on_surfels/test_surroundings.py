"""Scenes without masks: the whole room is learnt, and scenes with masks are learnt as ever."""

import math
from dataclasses import replace
from typing import Any

import pytest
import torch

from radiogs_core.contract import Run
from radiogs_core.learning.geometry import GeometryLearning
from radiogs_core.on_surfels import fit_geometry
from radiogs_core.on_surfels.fit_geometry import FitGeometry, Shading
from radiogs_core.plain_values import with_values
from radiogs_core.scene.scene import Scene
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.maps import radiance_maps
from radiogs_core.transport.splatting import Splat, splat
from rooms import room_scene
from scenes import sphere_scene
from short_training import BUDGET, CPU

STEPS, SURFELS = 200, 600
ROOM_BUDGET = with_values(
    BUDGET, {"geometry.steps": STEPS, "geometry.initial_surfels": SURFELS, "geometry.maximum_surfels": SURFELS}
)


def stage_on(scene: Scene) -> FitGeometry:
    return FitGeometry(Run(scene, None, None, 0, CPU), GeometryLearning(), ROOM_BUDGET.geometry, 1.0, Shading())


def trained(scene: Scene) -> tuple[float, Surfels]:
    """PSNR of new views, mean over the test views, and the surfels."""
    stage = stage_on(scene)
    while stage.iteration < stage.iterations:
        stage.step()
    shown = [radiance_maps(view.camera, stage.surfels)["image"] for view in scene.test]
    errors = [
        float((image - view.read("image")).square().mean()) for image, view in zip(shown, scene.test, strict=True)
    ]
    return -10 * math.fsum(map(math.log10, errors)) / len(errors), stage.surfels


@pytest.mark.slow
def test_new_views_of_a_room_need_the_surroundings() -> None:
    """The same photos; a mask of ones makes them a scene with masks, which starts from a ball in the middle."""
    ball_only, _ = trained(room_scene(masked=True))
    room, surfels = trained(room_scene())
    assert room > ball_only + 4
    distance = surfels.centre.norm(dim=-1)
    assert int((distance > 4).sum()) > SURFELS / 4, "density control leaves the walls"
    assert int((distance < 1).sum()) > SURFELS / 20, "and the ball"
    sparse, _ = trained(room_scene(points=300))
    assert sparse > ball_only + 5


def test_positional_steps_of_distant_surfels_scale_with_distance() -> None:
    stage = stage_on(room_scene())
    assert stage.space is not None
    before = stage.surfels.centre.detach().clone()
    expected = stage.position_rate() * stage.space.stretch(before)
    stage.step()  # Adam's first step has the length of the rate in every coordinate with a gradient
    moved = (stage.surfels.centre.detach() - before).abs().amax(-1)
    some = moved > 0
    assert int(some.sum()) > SURFELS / 4
    assert float(stage.space.stretch(before)[some].max()) > 3
    torch.testing.assert_close(moved[some], expected[some], rtol=0.02, atol=1e-6)


@pytest.mark.parametrize("depth", [0.5, 4.0])
def test_distortion_beyond_the_cameras_is_measured_in_disparity(depth: float, monkeypatch: pytest.MonkeyPatch) -> None:
    stage = stage_on(room_scene())
    stage.iteration = stage.iterations
    drawn: list[Splat] = []

    def at_a_depth(*given: Any) -> Splat:
        seen = splat(*given)
        drawn.append(seen)
        return replace(seen, depth=torch.full_like(seen.depth, depth * stage.depth_unit))

    monkeypatch.setattr(fit_geometry, "splat", at_a_depth)
    found = float(stage.losses(stage.views[0])["distortion"].detach())
    mean = float(drawn[0].distortion.detach().mean())
    assert found == pytest.approx(stage.learning.weights.distortion * mean / max(1, depth) ** 4, rel=1e-5)


def test_a_scene_is_surrounded_where_no_training_view_has_alpha() -> None:
    assert room_scene().surrounded
    masked = sphere_scene()
    assert not masked.surrounded
    assert stage_on(masked).space is None
    bare = replace(masked.train[0], sources={"image": masked.train[0].sources["image"]})
    assert not replace(masked, train=(bare, *masked.train[1:])).surrounded
    assert replace(masked, train=(bare,)).surrounded
