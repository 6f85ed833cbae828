"""From where a scene is looked at first: its eye, the upward direction of its cameras, and what they look at."""

from dataclasses import replace

import pytest
import torch

from radiogs_core.scene.scene import Scene, View
from radiogs_core.scene.standpoint import standpoint
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


def test_z_is_up_where_cameras_stand_upright_and_a_room_has_the_middle_that_they_look_at() -> None:
    room = scene()
    found = standpoint(room, room.test[0].camera)
    assert found.eye.tolist() == [3.0, 1.0, 2.0]
    assert found.up.tolist() == [0.0, 0.0, 1.0]
    assert found.middle is not None
    assert found.middle.allclose(TARGET, atol=1e-5)
    assert found.plain().keys() == {"eye", "up", "middle"}


def test_an_object_is_its_own_middle() -> None:
    masked = scene(masks=True)
    found = standpoint(masked, masked.test[0].camera)
    assert found.middle is None
    assert found.plain().keys() == {"eye", "up"}


def test_a_capture_has_an_upward_direction_of_its_own() -> None:
    turn = torch.eye(4)
    turn[1:3, 1:3] = torch.tensor([[0.0, -1.0], [1.0, 0.0]])  # Y points down
    turned = scene(turn)
    up = standpoint(turned, turned.test[0].camera).up
    assert up @ torch.tensor([0.0, -1.0, 0.0]) > 0.9
    assert float(up.norm()) == pytest.approx(1)
