"""K14 against the map's own lookup, which is PyTorch with PyTorch's gradients, and central differences."""

import math

import pytest
import torch

from radiogs_core.errors import DataError
from radiogs_core.kernels.runtime import use_threads
from radiogs_core.kernels.shade.lookup import look_up, texel_values
from radiogs_core.scene.light import EnvironmentMap
from reference.differences import assert_same_with_gradients

in_every_arrangement = pytest.mark.usefixtures("arrangement")

SIZES = [(1, 1), (1, 5), (5, 1), (2, 4), (7, 3), (16, 32)]


def radiance_map(height: int, width: int) -> torch.Tensor:
    return torch.rand(height, width, 3, dtype=torch.float64)


def around(*batch: int) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.randn(*batch, 3, dtype=torch.float64), dim=-1)


def along(column: torch.Tensor, row: torch.Tensor, height: int, width: int) -> torch.Tensor:
    """Unit directions towards places of a map, in texels from the centre of the first."""
    azimuth, polar = math.pi - (column + 0.5) * (2 * math.pi / width), (row + 0.5) * (math.pi / height)
    return torch.stack([polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos()], -1)


def expected(radiance: torch.Tensor, directions: torch.Tensor) -> torch.Tensor:
    return EnvironmentMap(radiance).lookup(directions)


@in_every_arrangement
@pytest.mark.parametrize("batch", [(), (1,), (16,), (3, 41)])
@pytest.mark.parametrize(("height", "width"), SIZES)
def test_float64_equals_the_maps_own_lookup_and_its_gradients(height: int, width: int, batch: tuple[int, ...]) -> None:
    assert_same_with_gradients(
        look_up, expected, radiance_map(height, width), 1.3 * around(*batch), values=1e-12, gradients=1e-9
    )


@in_every_arrangement
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize(("height", "width"), SIZES)
def test_a_direction_reads_the_texel_that_it_hits(height: int, width: int, dtype: torch.dtype) -> None:
    values = torch.rand(height, width, dtype=dtype)
    row, column = (torch.randint(size, (3, 41)) for size in (height, width))
    within = 0.98 * (torch.rand(2, 3, 41, dtype=torch.float64) - 0.5)
    directions = 1.3 * along(column + within[0], row + within[1], height, width)
    assert torch.equal(texel_values(values, directions), values[row, column])
    poles_and_none = torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [torch.nan, 0.0, 0.0]])
    top, bottom, unknown = texel_values(values, poles_and_none)
    assert bool((values[0] == top).any() and (values[-1] == bottom).any() and (values == unknown).any())


@in_every_arrangement
def test_gradients_equal_central_differences() -> None:
    """Within texels, across the seam, and nearer to the poles than the outermost rows; off the texels' borders."""
    column = torch.tensor([3.3, 2.6, -0.3, 7.4, 5.2, 1.7], dtype=torch.float64)
    row = torch.tensor([1.4, 2.7, 0.5, 1.6, -0.2, 3.3], dtype=torch.float64)
    directions = along(column, row, 4, 8).requires_grad_()
    assert torch.autograd.gradcheck(look_up, (radiance_map(4, 8).requires_grad_(), directions))
    assert torch.autograd.gradcheck(look_up, (radiance_map(1, 5).requires_grad_(), directions))


@in_every_arrangement
@pytest.mark.parametrize("part", [0, 1])
def test_tensors_without_requires_grad_get_no_gradient(part: int) -> None:
    both = [value.requires_grad_() for value in (radiance_map(4, 8), around(50))]
    look_up(*both).square().sum().backward()
    alone = [value.detach().clone().requires_grad_(k == part) for k, value in enumerate(both)]
    look_up(*alone).square().sum().backward()
    torch.testing.assert_close(alone[part].grad, both[part].grad, rtol=1e-12, atol=1e-13)
    assert alone[1 - part].grad is None


@in_every_arrangement
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_seam_has_two_sides_of_one_value(dtype: torch.dtype) -> None:
    radiance = radiance_map(4, 8).to(dtype)
    at_seam = torch.tensor([[-1.0, 0.0, 0.0], [-1.0, -0.0, 0.0], [-1.0, 1e-30, 0.0], [-1.0, -1e-30, 0.0]]).to(dtype)
    halfway = radiance[1:3][:, [0, -1]].mean((0, 1))
    torch.testing.assert_close(look_up(radiance, at_seam), halfway.expand(4, 3))


@in_every_arrangement
@pytest.mark.parametrize("height", [1, 4])
def test_the_poles_see_the_outermost_rows_without_gradient(height: int) -> None:
    radiance = radiance_map(height, 8)
    poles = torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], dtype=torch.float64).requires_grad_()
    found = look_up(radiance, poles)
    torch.testing.assert_close(found, expected(radiance, poles), rtol=1e-12, atol=1e-12)
    torch.testing.assert_close(found, radiance[[0, -1], 3:5].mean(1), rtol=1e-12, atol=1e-12)
    found.sum().backward()
    assert poles.grad is not None
    assert not bool(poles.grad.any())


@in_every_arrangement
@pytest.mark.parametrize("component", [0, 1, 2])
@pytest.mark.parametrize(("height", "width"), SIZES)
def test_a_direction_that_is_no_number_sees_none_and_spoils_no_other(height: int, width: int, component: int) -> None:
    radiance, directions = radiance_map(height, width), around(40)
    whole = look_up(radiance, directions)
    directions[7, component] = torch.nan
    directions.requires_grad_()
    found = look_up(radiance, directions)
    others = torch.arange(40) != 7
    assert bool(found[7].isnan().all())
    assert torch.equal(found[others], whole[others])
    found.sum().backward()
    assert directions.grad is not None
    assert bool(directions.grad[others].isfinite().all())


@in_every_arrangement
def test_a_direction_of_no_length_sees_what_the_maps_own_lookup_says_without_gradient() -> None:
    radiance, nowhere = radiance_map(4, 8), torch.zeros(3, dtype=torch.float64).requires_grad_()
    found = look_up(radiance, nowhere)
    torch.testing.assert_close(found, expected(radiance, nowhere), rtol=1e-12, atol=1e-12)
    found.sum().backward()
    assert nowhere.grad is not None
    assert not bool(nowhere.grad.any())


@in_every_arrangement
def test_zero_directions_give_an_empty_result() -> None:
    radiance, none = radiance_map(4, 8).requires_grad_(), torch.zeros(2, 0, 3, dtype=torch.float64).requires_grad_()
    found = look_up(radiance, none)
    assert found.shape == none.shape
    found.sum().backward()
    assert radiance.grad is not None
    assert not bool(radiance.grad.any())
    assert none.grad is not None
    assert none.grad.shape == none.shape


def test_results_repeat_and_values_do_not_depend_on_the_number_of_threads() -> None:
    radiance, directions, pull = radiance_map(16, 32).float(), around(3001).float(), torch.randn(3001, 3)
    found = []
    for threads in (1, 2, 2, 3):
        use_threads(threads)
        given = [value.clone().requires_grad_() for value in (radiance, directions)]
        value = look_up(*given)
        (value * pull).sum().backward()
        found.append([value, given[1].grad, given[0].grad])
    for each in found:
        for mine, first in zip(each[:2], found[0], strict=False):
            assert torch.equal(mine, first)
        torch.testing.assert_close(each[2], found[0][2], rtol=1e-5, atol=1e-5)
    assert torch.equal(found[1][2], found[2][2])


@in_every_arrangement
def test_float32_is_as_good_as_its_digits() -> None:
    exact = [value.float().double().requires_grad_() for value in (radiance_map(16, 32), around(6000))]
    rough = [value.detach().float().requires_grad_() for value in exact]
    found, wanted = look_up(*rough), expected(*exact)
    assert float((found - wanted).abs().max().detach()) < 5e-6
    found.sum().backward()
    wanted.sum().backward()
    torch.testing.assert_close(rough[0].grad.double(), exact[0].grad, rtol=1e-6, atol=1e-4)
    # Two or three directions of so many lie within a rounding of a texel's border, where the slope jumps.
    off = (rough[1].grad - exact[1].grad).norm(dim=-1) > 3e-5 * (exact[1].grad.norm(dim=-1) + 1)
    assert int(off.sum()) <= 3


def test_a_map_without_texels_is_refused() -> None:
    with pytest.raises(DataError):
        look_up(torch.zeros(0, 8, 3), torch.ones(5, 3))
