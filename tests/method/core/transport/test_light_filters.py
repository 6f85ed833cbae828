"""Filters of light against the whole matrices that they stand for."""

import pytest
import torch

from radiogs_core.scene.light import bilinear_texels, texel_directions, texel_solid_angles
from radiogs_core.transport.light_filters import GRID_HEIGHT, GRID_WIDTH, LEVELS, filtered, turned_spectrum

F64 = torch.float64
FILTERS = 1 + len(LEVELS)


def matrix(height: int, level: int) -> torch.Tensor:
    """The filter as a matrix of every point of the grid by every texel, balanced by hand until nothing moves."""
    texels = texel_directions(height, 2 * height).reshape(-1, 3)
    area = texel_solid_angles(height, 2 * height).expand(height, 2 * height).reshape(-1)
    cosine = (texel_directions(GRID_HEIGHT, GRID_WIDTH).reshape(-1, 3) @ texels.T).clamp(-1, 1)
    kernel = cosine.clamp(min=0)
    if level:
        sharp = LEVELS[level - 1] ** 4
        kernel = kernel * sharp / ((1 + cosine) / 2 * (sharp - 1) + 1) ** 2
    fine = texel_directions(512, 128).reshape(-1, 3)
    place, share = bilinear_texels(fine, GRID_HEIGHT, GRID_WIDTH)
    stands_for = torch.zeros(GRID_HEIGHT * GRID_WIDTH, dtype=F64).index_add(
        0, place.flatten(), (texel_solid_angles(512, 128).expand(512, 128).reshape(-1, 1) * share).flatten()
    )
    columns = area
    for _ in range(400):
        rows = 1 / (kernel @ columns)
        columns = area / ((stands_for * rows) @ kernel)
    return kernel * columns / (kernel @ columns)[:, None]


@pytest.mark.parametrize("height", [6, 10, 16, 32])
@pytest.mark.parametrize("level", [0, 1, 3, 5])
def test_a_filter_is_its_matrix_and_its_gradient_the_transposed_one(height: int, level: int) -> None:
    """Heights whose columns fall together with the grid's (16), twice (32), and at every second turn only (6, 10)."""
    light = torch.rand(height, 2 * height, 3, dtype=F64, requires_grad=True)
    pull = torch.rand(GRID_HEIGHT, GRID_WIDTH, 3, dtype=F64)
    found = filtered(turned_spectrum(light), height, level, 1)[0]
    found.backward(pull)
    whole = matrix(height, level)
    expected = (whole @ light.detach().reshape(-1, 3)).view(GRID_HEIGHT, GRID_WIDTH, 3)
    # Balanced to 1e-5 of every texel's energy (``ENERGY_TOLERANCE``), and the grid's solid angles are sums here.
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=0)
    assert light.grad is not None
    torch.testing.assert_close(light.grad.view(-1, 3), whole.T @ pull.reshape(-1, 3), rtol=2e-4, atol=0)


@pytest.mark.parametrize("height", [16, 32])
def test_a_turned_light_is_filtered_to_the_turned_grid(height: int) -> None:
    light = torch.rand(height, 2 * height, 3, dtype=F64)
    each = filtered(turned_spectrum(light), height, 0, FILTERS)
    turned = filtered(turned_spectrum(light.roll(3 * height // GRID_HEIGHT, 1)), height, 0, FILTERS)
    torch.testing.assert_close(turned, each.roll(3, 2), rtol=0, atol=1e-13)


def test_several_filters_at_once_are_those_one_by_one() -> None:
    spectrum = turned_spectrum(torch.rand(16, 32, 2, dtype=F64))
    together = filtered(spectrum, 16, 1, 5)
    assert torch.equal(together, torch.cat([filtered(spectrum, 16, 1 + level, 1) for level in range(5)]))
