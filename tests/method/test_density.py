import pytest
import torch

from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.density import SPLIT_SHRINK, Pull, densify_and_prune
from radiogs_core.surfels.surfels import Surfels, inverse_sigmoid, surfels_at


def _surfels() -> Surfels:
    """Four surfels: small and pulled, large and pulled, faint, and left alone."""
    generator = torch.Generator().manual_seed(0)
    surfels = surfels_at(
        torch.arange(12.0).view(4, 3), torch.tensor([0.005, 0.05, 0.05, 0.05]), torch.zeros(4, 3), generator
    )
    surfels.opacity_logit = torch.tensor([1.0, 1.0, inverse_sigmoid(0.01), 1.0])
    return surfels


def _pull(strength: list[float]) -> Pull:
    return Pull(torch.tensor(strength, dtype=torch.float32), torch.ones(4))


def test_small_ones_are_cloned_large_ones_split_and_faint_ones_pruned() -> None:
    surfels = _surfels()
    after, origin = densify_and_prune(surfels, _pull([1, 1, 1, 1e-9]), 1.0, 100, torch.Generator().manual_seed(0))
    assert origin.tolist() == [0, 3, -1, -1, -1]
    torch.testing.assert_close(after.centre[2], surfels.centre[0])
    torch.testing.assert_close(after.scale[3:], surfels.scale[1].expand(2, 2) / SPLIT_SHRINK)
    in_plane = (after.centre[3:] - surfels.centre[1]) @ surfels.frame[1, :, 2]
    torch.testing.assert_close(in_plane, torch.zeros(2), atol=1e-6, rtol=0)


def test_the_ceiling_admits_the_strongest_pulls_only() -> None:
    after, origin = densify_and_prune(_surfels(), _pull([1, 2, 0, 1e-9]), 1.0, 4, torch.Generator().manual_seed(0))
    assert len(after) == 4
    assert origin.tolist() == [0, 3, -1, -1]


def test_pull_is_the_gradient_of_a_shift_on_the_screen() -> None:
    camera = Camera(torch.eye(4, dtype=torch.float64), 40.0, 40.0, 32.0, 32.0, 64, 64)
    centre = torch.tensor([[0.3, -0.2, 5.0]], dtype=torch.float64)
    weight = torch.tensor([2.0, 3.0], dtype=torch.float64)

    def loss(half_images: torch.Tensor) -> torch.Tensor:
        # a loss that is linear in the position on the screen, in half-images
        return (half_images * weight).sum()

    centre.requires_grad_()
    on_screen = centre[0, :2] / centre[0, 2] * 40.0 / 32.0
    loss(on_screen).backward()
    assert centre.grad is not None
    pull = Pull(torch.zeros(1, dtype=torch.float64), torch.zeros(1, dtype=torch.float64))
    pull.observe(camera, centre.detach(), centre.grad, torch.tensor([True]))
    assert float(pull.mean()) == pytest.approx(float(weight.norm()))
