"""From where a scene is looked at first: its eye, the upward direction of its cameras, and what they look at."""

import math
from dataclasses import replace

import pytest
import torch

from radiogs_bench.initial_viewpoint import initial_viewpoint, upwards
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene, View
from scenes import look_at

TARGET = torch.tensor([0.0, 0.5, 0.0])
PLACES = ((3.0, 1.0, 2.0), (-3.0, 0.0, 1.0), (0.0, 4.0, 1.5))


def scene(turn: torch.Tensor | None = None, masks: bool = False) -> Scene:
    sources = {"image": lambda: torch.ones(8, 8, 3), **({"alpha": lambda: torch.ones(8, 8, 1)} if masks else {})}
    cameras = [look_at(torch.tensor(place), TARGET, 8, 8.0) for place in PLACES]
    if turn is not None:
        cameras = [replace(camera, camera_to_world=turn @ camera.camera_to_world) for camera in cameras]
    views = tuple(View(f"{place}", camera, sources) for place, camera in enumerate(cameras))
    return Scene("room", "none", views[1:], views[:1], {}, None, "0")


def ring(angles: list[float]) -> Scene:
    """Cameras on a circle around the origin, the first one for testing; no masks."""
    places = [torch.tensor([3 * math.cos(each), 3 * math.sin(each), 1.0]) for each in angles]
    cameras = [look_at(place, torch.zeros(3), 8, 8.0) for place in places]
    sources = {"image": lambda: torch.ones(8, 8, 3)}
    views = tuple(View(f"{place}", camera, sources) for place, camera in enumerate(cameras))
    return Scene("room", "none", views[1:], views[:1], {}, None, "0")


def test_z_is_up_where_cameras_stand_upright_and_a_room_has_the_middle_that_they_look_at() -> None:
    room = scene()
    found = initial_viewpoint(room, room.test[0].camera)
    assert found.eye.tolist() == [3.0, 1.0, 2.0]
    assert found.up.tolist() == [0.0, 0.0, 1.0]
    assert found.middle is not None
    assert found.middle.allclose(TARGET, atol=1e-5)
    assert found.plain().keys() == {"eye", "up", "middle", "arc"}, "cameras on three sides of it"


@pytest.mark.parametrize("turn", [0.0, 2.0, -2.0])
def test_the_arc_spans_the_cameras_to_both_sides_of_the_eye(turn: float) -> None:
    angles = turn + torch.tensor([0.4, -0.6, 0.0, 0.9])
    room = ring(angles.tolist())
    arc = initial_viewpoint(room, room.test[0].camera).arc
    assert arc is not None
    assert arc.tolist() == pytest.approx([-1.0, 0.5], abs=1e-3)


def test_a_room_that_was_seen_from_all_sides_is_gone_round() -> None:
    room = ring([place * math.pi / 4 for place in range(8)])
    assert initial_viewpoint(room, room.test[0].camera).arc is None


def test_an_object_is_its_own_middle() -> None:
    masked = scene(masks=True)
    found = initial_viewpoint(masked, masked.test[0].camera)
    assert found.middle is None
    assert found.plain().keys() == {"eye", "up"}


def test_a_capture_has_an_upward_direction_of_its_own() -> None:
    turn = torch.eye(4)
    turn[1:3, 1:3] = torch.tensor([[0.0, -1.0], [1.0, 0.0]])  # Y points down
    turned = scene(turn)
    up = initial_viewpoint(turned, turned.test[0].camera).up
    assert up @ torch.tensor([0.0, -1.0, 0.0]) > 0.9
    assert float(up.norm()) == pytest.approx(1)


def posed(axes: list[torch.Tensor], **fields: object) -> Scene:
    """Views whose cameras have these axes (columns: right, down, forward)."""
    views = []
    for place, each in enumerate(axes):
        pose = torch.eye(4)
        pose[:3, :3] = each
        camera = look_at(torch.tensor([3.0, 0.0, 1.0]), torch.zeros(3), 8, 8.0)
        views.append(View(f"{place}", replace(camera, camera_to_world=pose), {"image": lambda: torch.ones(8, 8, 3)}))
    made = Scene("capture", "none", tuple(views[1:]), tuple(views[:1]), {}, None, "0")
    return replace(made, **fields)  # type: ignore[arg-type]


def level(azimuths: list[float], lowered: float, roll: int = 0) -> list[torch.Tensor]:
    """Axes of cameras that look inwards from azimuths, ``lowered`` radians downwards, rolled by right angles."""
    found = []
    for azimuth in azimuths:
        inwards = torch.tensor([-math.cos(azimuth), -math.sin(azimuth), 0.0])
        z = torch.tensor([0.0, 0.0, 1.0])
        forward = math.cos(lowered) * inwards - math.sin(lowered) * z
        right = torch.linalg.cross(inwards, z)
        frame = torch.stack([right, torch.linalg.cross(forward, right), forward], -1)
        for _ in range(roll):
            frame = torch.stack([frame[:, 1], -frame[:, 0], frame[:, 2]], -1)
        found.append(frame)
    return found


TILT = torch.linalg.matrix_exp(torch.tensor([[0.0, 0.0, 0.6], [0.0, 0.0, 0.3], [-0.6, -0.3, 0.0]]))


@pytest.mark.parametrize("turn", [TILT, TILT @ TILT @ TILT, torch.diag(torch.tensor([1.0, -1.0, -1.0]))])
@pytest.mark.parametrize("azimuths", [[0.0, 0.6, 1.2, 1.9], [place * math.pi / 3 for place in range(6)]])
def test_up_is_at_right_angles_to_the_rows_of_level_photos(turn: torch.Tensor, azimuths: list[float]) -> None:
    """The mean upward direction of photos of one side leans towards the object."""
    found = upwards(posed([turn @ each for each in level(azimuths, 0.7)]))
    assert found.tolist() == pytest.approx(turn[:, 2].tolist(), abs=1e-5)


@pytest.mark.parametrize("roll", [1, 3])
def test_up_is_found_where_upright_photos_are_stored_lying(roll: int) -> None:
    ring = [place * math.pi / 3 for place in range(6)]
    found = upwards(posed([TILT @ each for each in level(ring, 0.4, roll)]))
    assert found.tolist() == pytest.approx(TILT[:, 2].tolist(), abs=1e-5)


def test_up_is_the_mean_on_a_line_and_z_where_the_scene_has_lights_of_its_own() -> None:
    along = [TILT @ each for each in level([0.0] * 4, 0.0)]
    assert upwards(posed(along)).tolist() == pytest.approx(TILT[:, 2].tolist(), abs=1e-5)
    light = EnvironmentMap(torch.ones(2, 4, 3))
    assert upwards(posed(along, lights={"sky": light})).tolist() == [0, 0, 1]
    assert upwards(posed(along, training_light=light)).tolist() == [0, 0, 1]
    slight = torch.linalg.matrix_exp(torch.tensor([[0.0, 0.0, 0.1], [0.0, 0.0, 0.0], [-0.1, 0.0, 0.0]]))
    assert upwards(posed([slight @ each for each in level([0.0, 1.0, 2.0], 0.3)])).tolist() == [0, 0, 1]
