"""K3 against a dense float64 implementation, finite differences and furnaces."""

import pytest
import torch

from radiogs.kernels.runtime import use_threads
from radiogs.kernels.shade import shade
from radiogs.light import EnvironmentMap
from radiogs.sampling import hemisphere_directions
from reference.shade import shade as dense_shade

NAMES = ("normal", "albedo", "roughness", "outgoing", "direction", "weight", "visibility", "indirect", "environment")
DIFFERENTIABLE = ("normal", "albedo", "roughness", "visibility", "indirect", "environment")


def unit(*shape: int) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.randn(*shape, dtype=torch.float64), dim=-1)


def inputs(surfels: int = 12, views: int = 2, samples: int = 16) -> dict[str, torch.Tensor]:
    normal = unit(surfels, 3)
    direction, weight = hemisphere_directions(normal, samples, torch.Generator().manual_seed(0))
    return {
        "normal": normal,
        "albedo": torch.rand(surfels, 3, dtype=torch.float64),
        "roughness": 0.1 + 0.9 * torch.rand(surfels, dtype=torch.float64),
        "outgoing": unit(surfels, views, 3),
        "direction": torch.where(torch.rand(surfels, samples, 1) < 0.1, -direction, direction),
        "weight": weight,
        "visibility": torch.rand(surfels, samples, dtype=torch.float64),
        "indirect": torch.rand(surfels, samples, 3, dtype=torch.float64),
        "environment": torch.rand(6, 12, 3, dtype=torch.float64),
    }


def gradients(function: object, given: dict[str, torch.Tensor], pull: torch.Tensor) -> dict[str, torch.Tensor]:
    leaves = {name: value.clone().requires_grad_(name in DIFFERENTIABLE) for name, value in given.items()}
    (function(*leaves.values()) * pull).sum().backward()  # type: ignore[operator]
    return {name: leaves[name].grad for name in DIFFERENTIABLE}  # type: ignore[misc]


def test_float64_equals_the_dense_sum_and_its_gradients() -> None:
    given = inputs()
    found, expected = shade(*given.values()), dense_shade(*given.values())
    torch.testing.assert_close(found, expected, rtol=1e-11, atol=1e-13)
    pull = torch.randn_like(found)
    ours, theirs = gradients(shade, given, pull), gradients(dense_shade, given, pull)
    for name in DIFFERENTIABLE:
        assert theirs[name].abs().max() > 0, f"no gradient to {name}"
        assert (ours[name] - theirs[name]).abs().max() < 1e-9 * theirs[name].abs().max(), name


def test_gradients_equal_central_differences_in_random_directions() -> None:
    given = inputs(surfels=4)
    pull = torch.randn(4, 2, 4, 3, dtype=torch.float64)
    slopes = gradients(shade, given, pull)
    step = 1e-6
    for _ in range(8):
        shift = {name: torch.randn_like(given[name]) for name in DIFFERENTIABLE}

        def value(sign: float, shift: dict[str, torch.Tensor] = shift) -> torch.Tensor:
            moved = {name: given[name] + sign * step * shift[name] if name in shift else given[name] for name in NAMES}
            return (shade(*moved.values()) * pull).sum()

        numeric = (value(1) - value(-1)) / (2 * step)
        analytic = sum((slopes[name] * shift[name]).sum() for name in DIFFERENTIABLE)
        assert float(numeric) == pytest.approx(float(analytic), rel=1e-5)


def test_float32_agrees_with_float64_on_the_rounded_inputs() -> None:
    given = {name: value.float() for name, value in inputs(surfels=200).items()}
    rounded = {name: value.double() for name, value in given.items()}
    pull = torch.randn(200, 2, 4, 3)
    ours, exact = gradients(shade, given, pull), gradients(shade, rounded, pull.double())
    for name in DIFFERENTIABLE:
        error = (ours[name].double() - exact[name]).abs() / exact[name].abs().max()
        assert (error < 1e-4).double().mean() > 0.99, name


@pytest.mark.parametrize("samples", [4, 16, 64, 256])
def test_white_furnace_has_no_bias_at_any_number_of_samples(samples: int) -> None:
    """A white Lambert surface under constant light 1 sends 1 (the sample set's cosines sum to exactly pi)."""
    normal = unit(50, 3)
    direction, weight = hemisphere_directions(normal, samples, torch.Generator().manual_seed(0))
    one = torch.ones(50, samples, dtype=torch.float64)
    parts = shade(
        normal, torch.ones_like(normal), torch.ones(50, dtype=torch.float64), normal[:, None], direction, weight,
        one, one[..., None].expand(-1, -1, 3) * 0, torch.ones(4, 8, 3, dtype=torch.float64),
    )  # fmt: skip
    torch.testing.assert_close(parts[:, 0, 0], torch.ones_like(normal), rtol=1e-12, atol=0)


def test_lookup_in_the_kernel_is_the_environment_maps_own() -> None:
    light = EnvironmentMap(torch.rand(8, 16, 3, dtype=torch.float64))
    toward = torch.cat([unit(100, 3), torch.eye(3, dtype=torch.float64), -torch.eye(3, dtype=torch.float64)])
    count = len(toward)
    parts = shade(
        toward, torch.full((count, 3), torch.pi, dtype=torch.float64), torch.ones(count, dtype=torch.float64),
        toward[:, None], toward[:, None], torch.ones(count, 1, dtype=torch.float64),
        torch.ones(count, 1, dtype=torch.float64), torch.zeros(count, 1, 3, dtype=torch.float64), light.radiance,
    )  # fmt: skip
    torch.testing.assert_close(parts[:, 0, 0], light.lookup(toward))


@pytest.mark.parametrize("team", [1, 2])
def test_results_repeat_bit_for_bit(team: int) -> None:
    use_threads(team)
    given = {name: value.float() for name, value in inputs(surfels=100).items()}
    pull = torch.randn(100, 2, 4, 3)
    first, second = gradients(shade, given, pull), gradients(shade, given, pull)
    assert all(torch.equal(first[name], second[name]) for name in DIFFERENTIABLE)


def test_no_surfel_gives_no_radiance() -> None:
    given = {name: value[:0] for name, value in inputs().items() if name != "environment"}
    assert shade(*given.values(), torch.ones(4, 8, 3, dtype=torch.float64)).shape == (0, 2, 4, 3)
