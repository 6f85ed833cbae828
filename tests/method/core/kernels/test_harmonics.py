"""K4 against the basis as one writes it, in float64, with PyTorch's own gradients."""

import pytest
import torch

from radiogs_core.kernels.runtime import use_threads
from radiogs_core.kernels.surfel.harmonics import harmonic_sum
from reference.differences import assert_same_with_gradients
from reference.trace import harmonics


def dense(sh: torch.Tensor, direction: torch.Tensor) -> torch.Tensor:
    return torch.einsum("nvk,nkc->nvc", harmonics(direction)[..., : sh.shape[1]], sh)


def inputs(coefficients: int, views: int, surfels: int = 40) -> tuple[torch.Tensor, torch.Tensor]:
    direction = torch.nn.functional.normalize(torch.randn(surfels, views, 3, dtype=torch.float64), dim=-1)
    return torch.randn(surfels, coefficients, 3, dtype=torch.float64), direction


@pytest.mark.parametrize("coefficients", [1, 4, 9, 16])
@pytest.mark.parametrize("views", [1, 3])
def test_float64_equals_the_dense_sum_and_its_gradients(coefficients: int, views: int) -> None:
    assert_same_with_gradients(harmonic_sum, dense, *inputs(coefficients, views), values=1e-12, gradients=1e-11)


def test_float32_is_as_good_as_its_digits() -> None:
    sh, direction = inputs(16, 2, 500)
    found = harmonic_sum(sh.float(), direction.float()).double()
    assert (found - dense(sh, direction)).abs().max() < 1e-5


@pytest.mark.parametrize("threads", [1, 2])
def test_what_is_no_number_stays_with_its_surfel(threads: int) -> None:
    use_threads(threads)
    sh, direction = inputs(9, 1)
    sh[7, 3, 1] = torch.nan
    found = harmonic_sum(sh, direction)
    assert torch.isnan(found[7, 0, 1])
    assert torch.isfinite(torch.cat([found[:7], found[8:]])).all()


def test_zero_surfels_give_an_empty_result() -> None:
    assert harmonic_sum(torch.zeros(0, 16, 3), torch.zeros(0, 2, 3)).shape == (0, 2, 3)
