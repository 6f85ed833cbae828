"""The two losses of the light against their formulas, written out in numpy."""

import math

import numpy as np
import pytest
import torch

from radiogs_core.learning.losses import environment_smoothness, light_prior
from radiogs_core.scene.light import texel_directions

HEIGHT, WIDTH = 5, 10


def sky(seed: int = 0) -> torch.Tensor:
    return torch.rand(HEIGHT, WIDTH, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64) + 0.05


def test_smoothness_is_the_mean_square_of_what_neighbouring_logarithms_differ_by() -> None:
    radiance = sky()
    value = np.log(radiance.numpy())
    around = [
        (value[row, column] - value[row, (column + 1) % WIDTH]) ** 2 for row in range(HEIGHT) for column in range(WIDTH)
    ]
    down = [(value[row, column] - value[row + 1, column]) ** 2 for row in range(HEIGHT - 1) for column in range(WIDTH)]
    assert float(environment_smoothness(radiance)) == pytest.approx(float(np.mean(around) + np.mean(down)), rel=1e-12)


def test_the_gradient_of_smoothness_is_that_of_central_differences() -> None:
    assert torch.autograd.gradcheck(lambda radiance: 3 * environment_smoothness(radiance), sky().requires_grad_())


def test_smoothness_wraps_around_in_longitude_and_ends_at_the_poles() -> None:
    """Wherever the seam is cut, it is the same light; a step between the poles is none."""
    radiance = sky()
    turned = [float(environment_smoothness(radiance.roll(shift, dims=1))) for shift in range(WIDTH)]
    assert turned == pytest.approx([turned[0]] * WIDTH, rel=1e-12)
    ramp = torch.arange(1.0, HEIGHT + 1, dtype=torch.float64).exp()[:, None, None].expand(HEIGHT, WIDTH, 3)
    assert float(environment_smoothness(ramp)) == pytest.approx(1.0)


def test_smoothness_pulls_neighbours_together_whatever_the_exposure() -> None:
    radiance = torch.ones(HEIGHT, WIDTH, 3, dtype=torch.float64)
    radiance[2, 3] = 4.0
    logarithm = radiance.log().requires_grad_()
    loss = environment_smoothness(logarithm.exp())
    loss.backward()
    assert logarithm.grad is not None
    assert bool((logarithm.grad[2, 3] > 0).all())
    assert bool((logarithm.grad[2, [2, 4]] < 0).all())
    assert float(environment_smoothness(7 * radiance)) == pytest.approx(float(loss.detach()), rel=1e-12)


def test_the_prior_is_the_mean_distance_of_channels_from_their_mean() -> None:
    incident = sky()[0]
    rows = [[abs(value - sum(row) / 3) for value in row] for row in incident.tolist()]
    assert float(light_prior(incident)) == pytest.approx(float(np.mean(rows)), rel=1e-12)


def test_the_prior_pulls_a_tint_back_to_grey() -> None:
    incident = torch.tensor([[0.9, 0.6, 0.3]], dtype=torch.float64, requires_grad=True)
    light_prior(incident).backward()
    assert incident.grad is not None
    red, green, blue = incident.grad[0].tolist()
    assert red > 0 > blue
    assert green == pytest.approx(0.0, abs=1e-12)


def test_the_prior_does_not_mind_a_sun() -> None:
    towards = texel_directions(HEIGHT, WIDTH)[1, 3]
    bright = (texel_directions(HEIGHT, WIDTH) @ towards > math.cos(0.3)).double() * 100
    assert float(light_prior((0.1 + bright).reshape(-1, 1).expand(-1, 3))) < 1e-12
