"""K16 against PyTorch's own operations."""

import pytest
import torch

from radiogs_core.kernels.image.matching import Matched, Textures, matching_costs
from radiogs_core.kernels.runtime import use_threads
from radiogs_core.scene.camera import Camera
from reference import matching as reference

PLANES = torch.linspace(0.5, 9.0, 12, dtype=torch.float64)


def camera_at(angle: float, width: int, height: int) -> Camera:
    """On a circle of radius 3 about the Z axis, towards the origin."""
    turn = torch.tensor(angle, dtype=torch.float64)
    back = torch.stack([turn.cos(), turn.sin(), torch.zeros_like(turn)])
    up = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3, :3] = torch.stack([torch.linalg.cross(up, back), -up, -back], 1)
    pose[:3, 3] = 3 * back
    return Camera(pose, 1.1 * width, 1.2 * width, 0.45 * width, 0.55 * height, width, height)


def seen(angle: float, width: int, height: int) -> tuple[Camera, torch.Tensor, torch.Tensor]:
    """A camera, random colours, and where they are covered: not everywhere, and black elsewhere."""
    covered = torch.rand(height, width) > 0.3
    colour = torch.rand(3, height, width, dtype=torch.float64) * covered
    return camera_at(angle, width, height), colour, covered


def matched_of(camera: Camera, colour: torch.Tensor, covered: torch.Tensor) -> Matched:
    """All covered pixels in a box as large as the image."""
    return Matched(camera, covered, camera.ray_directions()[covered], colour[:, covered])


@pytest.mark.parametrize(("window", "agreeing"), [(1, 1), (3, 2), (5, 9), (7, 4)])
@pytest.mark.parametrize("team", [1, 2])
def test_matching_costs_equal_a_reference_that_samples_windows_and_sorts(window: int, agreeing: int, team: int) -> None:
    use_threads(team)
    # Two nearly opposite cameras have planes behind them; images differ in size.
    views = [seen(0.0, 13, 10), seen(0.4, 13, 10), seen(-0.5, 9, 17), seen(3.0, 21, 8), seen(1.5, 13, 10)]
    matched, textures = matched_of(*views[0]), Textures(*zip(*views, strict=True))
    found = matching_costs(matched, textures, [2, 1, 4, 3], PLANES, window, agreeing)
    expected = reference.matching_costs(matched, [views[k] for k in (2, 1, 4, 3)], PLANES, window, agreeing)
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-12)
    assert float(found.min()) < 0.7 < 0.85 < float(found.max()), "others see some pixels, and hardly see some"


def test_float32_agrees_with_float64_except_where_a_pixel_crosses_a_threshold() -> None:
    views = [seen(0.1 * number, 40, 30) for number in range(5)]
    exact = matching_costs(matched_of(*views[0]), Textures(*zip(*views, strict=True)), [1, 2, 3, 4], PLANES, 3, 2)
    rounded = [(camera.to("cpu", torch.float32), colour.float(), covered) for camera, colour, covered in views]
    textures = Textures(*zip(*rounded, strict=True))
    found = matching_costs(matched_of(*rounded[0]), textures, [1, 2, 3, 4], PLANES.float(), 3, 2)
    assert float(((found - exact).abs() > 1e-4).double().mean()) < 0.01
