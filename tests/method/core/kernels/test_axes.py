"""K19 against PyTorch's operations and their gradients."""

import pytest
import torch
from torch import Tensor

from radiogs_core.kernels.surfel.footprint import met_by_rays
from reference.differences import assert_same_with_gradients


def surfels(dtype: torch.dtype = torch.float64) -> list[Tensor]:
    """Frames, log-scales and logits of opacity."""
    frame = torch.linalg.qr(torch.randn(30, 3, 3, dtype=torch.float64)).Q
    log_scale, opacity_logit = torch.randn(30, 2, dtype=torch.float64), 3 * torch.randn(30, dtype=torch.float64)
    return [value.to(dtype) for value in (frame, log_scale, opacity_logit)]


def ours(frame: Tensor, log_scale: Tensor, opacity_logit: Tensor) -> tuple[Tensor, ...]:
    found = met_by_rays(torch.zeros_like(frame[..., 0]), frame, log_scale, opacity_logit)
    return found.axis_u, found.axis_v, found.normal, found.opacity


def theirs(frame: Tensor, log_scale: Tensor, opacity_logit: Tensor) -> tuple[Tensor, ...]:
    axes, normal = frame.split([2, 1], -1)
    axis_u, axis_v = (axes / log_scale.exp()[:, None]).unbind(-1)
    return axis_u, axis_v, normal[..., 0], opacity_logit.sigmoid()


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-12), (torch.float32, 1e-5)])
def test_axes_and_their_gradients_are_those_of_the_formulas(dtype: torch.dtype, tolerance: float) -> None:
    assert_same_with_gradients(ours, theirs, *surfels(dtype), values=tolerance, gradients=tolerance)


def test_memory_with_gaps_is_read_as_it_is_meant() -> None:
    given = surfels()
    spread = [value.repeat_interleave(2, -1)[..., ::2] for value in given]
    assert not any(value.is_contiguous() for value in spread)
    for one, other in zip(ours(*spread), ours(*given), strict=True):
        assert torch.equal(one, other)
    pulls = [value.mT for value in torch.randn(3, 3, 30, dtype=torch.float64)]
    leaves = [value.requires_grad_() for value in given]
    found, copied = (
        torch.autograd.grad(ours(*leaves)[:3], leaves[:2], by) for by in (pulls, [pull.contiguous() for pull in pulls])
    )
    assert all(map(torch.equal, found, copied))
