"""Space beyond the cameras is contracted by disparity, and what is in it grows with its distance."""

import pytest
import torch

from radiogs_core.scene.contraction import Contraction
from scenes import sphere_scene

SPACE = Contraction(torch.tensor([1.0, -2.0, 0.5], dtype=torch.float64), 4.0)
DIRECTION = torch.nn.functional.normalize(torch.tensor([0.3, -0.5, 0.8], dtype=torch.float64), dim=0)


def at(*distances: float) -> torch.Tensor:
    return SPACE.centre + torch.tensor(distances, dtype=torch.float64)[:, None] * DIRECTION


def test_inside_the_ball_nothing_changes_but_the_unit() -> None:
    torch.testing.assert_close(
        SPACE.contracted(at(0.0, 1.0, 4.0)).norm(dim=-1), torch.tensor([0.0, 0.25, 1.0]).double()
    )
    assert SPACE.stretch(at(0.0, 1.0, 4.0)).tolist() == [1.0, 1.0, 1.0]


def test_outside_equal_steps_are_equal_disparities() -> None:
    found = SPACE.contracted(at(4.0, 8.0, 16.0, 4e6))
    torch.testing.assert_close(found @ DIRECTION, torch.tensor([1.0, 1.5, 1.75, 2 - 1e-6]).double())
    torch.testing.assert_close(SPACE.stretch(at(8.0, 40.0)), torch.tensor([2.0, 10.0]).double())


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_the_ball_of_a_scene_holds_its_cameras(scale: float) -> None:
    scene = sphere_scene(scale=scale)
    distance = max(float((view.camera.centre - scene.centre).norm()) for view in scene.train)
    assert Contraction.of(scene).radius == pytest.approx(distance)
    assert distance == pytest.approx(scale * 4, rel=0.05)
