"""A turntable: cameras that see the whole model with Z up, and pictures blended in linear light on white."""

import math

import pytest
import torch

from radiogs_bench.export.turntable import ELEVATION, cameras_around, from_outside, pictures
from radiogs_bench.initial_viewpoint import InitialViewpoint
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.surfels.harmonics import CONSTANT_BASIS
from radiogs_core.surfels.surfels import Surfels, inverse_sigmoid, roughness_to_logit


def surfels(centre: list[list[float]], opacity: list[float], colour: list[list[float]], scale: float) -> Surfels:
    """Discs that face +X."""
    count = len(centre)
    turn = torch.tensor([0.5**0.5, 0.0, 0.5**0.5, 0.0])  # Z to X
    sh = torch.zeros(count, 16, 3)
    sh[:, 0] = (torch.tensor(colour) - 0.5) / CONSTANT_BASIS
    return Surfels(
        centre=torch.tensor(centre),
        rotation=turn.repeat(count, 1),
        log_scale=torch.full((count, 2), scale).log(),
        opacity_logit=torch.tensor([inverse_sigmoid(each) for each in opacity]),
        sh=sh,
        albedo_logit=torch.full((count, 3), inverse_sigmoid(0.3)),
        roughness_logit=torch.full((count,), roughness_to_logit(0.6)),
    )


def ball() -> Surfels:
    """Surfels all around the point (5, 6, 7)."""
    generator = torch.Generator().manual_seed(2)
    around = torch.nn.functional.normalize(torch.randn(200, 3, generator=generator), dim=-1)
    places = (around + torch.tensor([5.0, 6.0, 7.0])).tolist()
    return surfels(places, [0.5] * 200, [[0.5] * 3] * 200, 0.1)


def test_cameras_stand_around_the_model_and_see_all_of_it() -> None:
    model = ball()
    cameras = cameras_around(model, 4, 64, from_outside(model))
    middle = model.centre.median(0).values
    for turn, camera in zip((0.0, 90.0, 180.0, 270.0), cameras, strict=True):
        back = torch.nn.functional.normalize(camera.centre - middle, dim=0)
        assert float(torch.rad2deg(back[2].asin())) == pytest.approx(ELEVATION, abs=1e-3)
        assert float(torch.rad2deg(torch.atan2(back[1], back[0]))) % 360 == pytest.approx(turn, abs=1e-3)
        seen = (model.centre - camera.centre) @ camera.axes
        pixels = seen[:, :2] / seen[:, 2:] * camera.fx + 32
        assert (pixels > 0).all()
        assert (pixels < 64).all()
        assert pixels.max() - pixels.min() > 50, "and fill the picture"
        above = (middle + torch.tensor([0.0, 0.0, 0.5]) - camera.centre) @ camera.axes
        assert above[1] < -0.1, "up is up"


def test_in_a_room_cameras_stand_where_its_photos_were_taken() -> None:
    middle, up = torch.tensor([5.0, 6.0, 7.0]), torch.tensor([0.0, -1.0, 0.0])
    eye = middle + torch.tensor([3.0, -1.5, 0.0])
    first, second = cameras_around(ball(), 4, 64, InitialViewpoint(eye, up, middle))[:2]
    assert first.centre.allclose(eye, atol=1e-5)
    assert second.centre.allclose(middle + torch.tensor([0.0, -1.5, 3.0]), atol=1e-5), "turned about the upward axis"
    for camera in (first, second):
        assert (-camera.axes[:, 1]) @ up > 0.8
        towards = (middle - camera.centre) @ camera.axes
        assert towards[:2].abs().max() < 1e-5, "the middle of the room is in the middle of the picture"


def test_in_a_room_they_stay_within_the_arc_of_its_photos() -> None:
    middle, up = torch.zeros(3), torch.tensor([0.0, 0.0, 1.0])
    seen_from = InitialViewpoint(torch.tensor([2.0, 0.0, 1.0]), up, middle, torch.tensor([-0.5, 1.5]))
    cameras = cameras_around(ball(), 40, 8, seen_from)
    turns = [math.atan2(float(camera.centre[1]), float(camera.centre[0])) for camera in cameras]
    assert turns[0] == pytest.approx(0, abs=1e-5)
    assert max(turns) == pytest.approx(1.5, abs=0.02)
    assert min(turns) == pytest.approx(-0.5, abs=0.02)
    assert max(abs(one - other) for one, other in zip(turns, [*turns[1:], turns[0]], strict=True)) < 0.2


def test_a_model_is_seen_from_the_side_of_its_first_camera() -> None:
    model = ball()
    middle = model.centre.median(0).values
    seen_from = InitialViewpoint(middle + torch.tensor([0.0, 9.0, 0.0]), torch.tensor([0.0, 0.0, 1.0]))
    back = cameras_around(model, 2, 8, seen_from)[0].centre - middle
    assert float(torch.rad2deg(torch.atan2(back[1], back[0]))) == pytest.approx(90, abs=1e-3)
    assert float(torch.rad2deg((back[2] / back.norm()).asin())) == pytest.approx(ELEVATION, abs=1e-3)


def test_pictures_are_blended_in_linear_light_on_white() -> None:
    model = surfels([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]], [0.6, 0.8], [[0.0, 1.0, 0.0], [0.5, 0.0, 0.0]], 5.0)
    front, back = cameras_around(ball(), 2, 9, from_outside(ball()))
    seen = []
    for camera in (front, back):  # around (5, 6, 7): moved to the discs
        pose = camera.camera_to_world.clone()
        pose[:3, 3] -= torch.tensor([5.0, 6.0, 7.0])
        (picture,) = pictures(model, [type(camera)(pose, camera.fx, camera.fy, 4.5, 4.5, 9, 9)], "radiance")
        seen.append(picture[4, 4])
    white = 0.2 * 0.4
    assert seen[0] == pytest.approx(srgb_encode(torch.tensor([0.4, 0.12, 0.0]) + white), abs=0.01)
    assert seen[1] == pytest.approx(torch.ones(3), abs=1e-3), "surfels have no back"


@pytest.mark.parametrize(
    ("colour", "wanted"),
    [
        ("albedo", srgb_encode(torch.full((3,), 0.3))),
        ("normal", torch.tensor([1.0, 0.5, 0.5])),
        ("roughness", torch.full((3,), 0.6)),
    ],
)
def test_pictures_are_in_display_colours(colour: str, wanted: torch.Tensor) -> None:
    model = surfels([[0.0, 0.0, 0.0]] * 30, [0.99] * 30, [[0.2] * 3] * 30, 5.0)
    (camera,) = cameras_around(model, 1, 5, from_outside(model))
    (picture,) = pictures(model, [camera], colour)  # type: ignore[arg-type]
    assert picture[2, 2] == pytest.approx(wanted, abs=0.01)
