"""The two losses of the light against their formulas, written out in numpy."""

import numpy as np
import pytest
import torch

from radiogs_core.learning.losses import environment_smoothness, light_prior

HEIGHT, WIDTH = 5, 10


def sky(seed: int = 0) -> torch.Tensor:
    return torch.rand(HEIGHT, WIDTH, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64) + 0.05


def test_smoothness_is_the_mean_squared_difference_of_neighbouring_logarithms() -> None:
    radiance = sky()
    value = np.log(radiance.numpy())
    around = [
        (value[row, column] - value[row, (column + 1) % WIDTH]) ** 2 for row in range(HEIGHT) for column in range(WIDTH)
    ]
    down = [(value[row, column] - value[row + 1, column]) ** 2 for row in range(HEIGHT - 1) for column in range(WIDTH)]
    assert float(environment_smoothness(radiance)) == pytest.approx(float(np.mean(around) + np.mean(down)), rel=1e-12)


def test_the_gradient_of_smoothness_agrees_with_central_differences() -> None:
    assert torch.autograd.gradcheck(lambda radiance: 3 * environment_smoothness(radiance), sky().requires_grad_())


def test_the_prior_is_the_mean_distance_of_channels_from_their_mean() -> None:
    incident = sky()[0]
    rows = [[abs(value - sum(row) / 3) for value in row] for row in incident.tolist()]
    assert float(light_prior(incident)) == pytest.approx(float(np.mean(rows)), rel=1e-12)
