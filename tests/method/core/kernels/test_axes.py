"""K19 against PyTorch's operations and their gradients."""

import pytest
import torch
from torch import Tensor

from radiogs_core.kernels.surfel.axes import met_by_rays

NAMES = ("frame", "log_scale", "opacity_logit")


def surfels(dtype: torch.dtype = torch.float64) -> dict[str, Tensor]:
    given = {
        "frame": torch.linalg.qr(torch.randn(30, 3, 3, dtype=torch.float64)).Q,
        "log_scale": torch.randn(30, 2, dtype=torch.float64),
        "opacity_logit": 3 * torch.randn(30, dtype=torch.float64),
    }
    return {name: value.to(dtype) for name, value in given.items()}


def ours(given: dict[str, Tensor]) -> tuple[Tensor, ...]:
    found = met_by_rays(torch.zeros_like(given["frame"][..., 0]), *given.values())
    return found.axis_u, found.axis_v, found.normal, found.opacity


def theirs(given: dict[str, Tensor]) -> tuple[Tensor, ...]:
    axes, normal = given["frame"].split([2, 1], -1)
    axis_u, axis_v = (axes / given["log_scale"].exp()[:, None]).unbind(-1)
    return axis_u, axis_v, normal[..., 0], given["opacity_logit"].sigmoid()


def gradients(found: tuple[Tensor, ...], pulls: list[Tensor], given: dict[str, Tensor]) -> list[Tensor]:
    return list(torch.autograd.grad(found, list(given.values()), pulls))


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-12), (torch.float32, 1e-5)])
def test_axes_and_their_gradients_are_those_of_the_formulas(dtype: torch.dtype, tolerance: float) -> None:
    given = {name: value.requires_grad_() for name, value in surfels(dtype).items()}
    found, expected = ours(given), theirs(given)
    pulls = [torch.randn_like(value) for value in expected]
    pairs = [*zip(found, expected, strict=True)]
    pairs += zip(gradients(found, pulls, given), gradients(expected, pulls, given), strict=True)
    for one, other in pairs:
        assert other.abs().max() > 0
        torch.testing.assert_close(one, other, rtol=tolerance, atol=tolerance)


def test_memory_with_gaps_is_read_as_it_is_meant() -> None:
    given = surfels()
    spread = {name: value.repeat_interleave(2, -1)[..., ::2] for name, value in given.items()}
    assert not any(value.is_contiguous() for value in spread.values())
    for one, other in zip(ours(spread), ours(given), strict=True):
        assert torch.equal(one, other)
    pulls = [value.mT for value in torch.randn(3, 3, 30, dtype=torch.float64)]
    leaves = {name: value.requires_grad_() for name, value in given.items()}
    axes = ours(leaves)[:3]
    copies = [pull.contiguous() for pull in pulls]
    for one, other in zip(gradients(axes, pulls, leaves), gradients(ours(leaves)[:3], copies, leaves), strict=True):
        assert torch.equal(one, other)
