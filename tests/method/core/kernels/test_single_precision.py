"""Kernels whose own tests are in float64 alone compute the same in float32, forward and backward."""

from collections.abc import Callable

import pytest
import torch

from radiogs_core.kernels.image.depth_map import points_of
from radiogs_core.kernels.image.display import displayed
from radiogs_core.kernels.surfel.footprint import frames, widened
from radiogs_core.kernels.surfel.harmonics import harmonic_sum
from radiogs_core.scene.camera import Camera

CAMERA = Camera(torch.eye(4), 20.0, 19.0, 4.3, 3.5, 9, 7)


def axes_of_widened(rotation: torch.Tensor, scale: torch.Tensor) -> torch.Tensor:
    centre, opacity = rotation[:, :3].detach() + torch.tensor([0, 0, 6]).to(scale), torch.full_like(scale[:, 0], 0.5)
    return widened(CAMERA.to(dtype=scale.dtype), centre, frames(rotation), 0.01 + scale.square(), opacity).axis_u


def points(depth: torch.Tensor) -> torch.Tensor:
    return points_of(CAMERA.to(dtype=depth.dtype), 3 + depth)


def shown(blended: torch.Tensor, alpha: torch.Tensor) -> torch.Tensor:
    return displayed(blended.square(), alpha.sigmoid())


@pytest.mark.parametrize(
    ("function", "shapes"),
    [
        (axes_of_widened, [(20, 4), (20, 2)]),
        (points, [(7, 9)]),
        (shown, [(2, 7, 9, 3), (7, 9)]),
        (harmonic_sum, [(20, 16, 3), (20, 2, 3)]),
    ],
)
def test_float32_agrees_with_float64(function: Callable[..., torch.Tensor], shapes: list[tuple[int, ...]]) -> None:
    given = [torch.randn(shape, dtype=torch.float64) for shape in shapes]

    def found(dtype: torch.dtype) -> list[torch.Tensor]:
        leaves = [value.to(dtype).requires_grad_() for value in given]
        out = function(*leaves)
        return [out.detach(), *torch.autograd.grad(out.sum(), leaves)]

    for single, double in zip(found(torch.float32), found(torch.float64), strict=True):
        assert single.dtype == torch.float32
        torch.testing.assert_close(single.double(), double, rtol=1e-3, atol=1e-4)
