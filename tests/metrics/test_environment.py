"""Errors of environment maps on maps whose integrals are known."""

import math

import pytest
import torch

from radiogs_bench.scoring.metrics.conventions import Environment
from radiogs_bench.scoring.metrics.environment import environment_error
from radiogs_bench.scoring.metrics.protocols import protocol
from radiogs_core.errors import UsageError

SCALES = ("none", "one factor", "factor a channel")


def light(height: int = 16) -> torch.Tensor:
    return torch.rand(height, 2 * height, 3) ** 8 * 100


@pytest.mark.parametrize("scale", SCALES)
def test_the_true_light_is_exact_and_darkness_is_one(scale: str) -> None:
    truth = light()
    assert environment_error(truth, truth, Environment(scale)) == pytest.approx(0, abs=1e-12)
    assert environment_error(torch.zeros_like(truth), truth, Environment(scale)) == pytest.approx(1)


def test_scales_forgive_what_they_name() -> None:
    truth = light()
    grey, coloured = 3 * truth, torch.tensor([3.0, 0.5, 1.0]) * truth
    assert environment_error(grey, truth) == pytest.approx(4)
    assert environment_error(grey, truth, Environment("one factor")) == pytest.approx(0, abs=1e-9)
    assert environment_error(coloured, truth, Environment("one factor")) > 0.01
    assert environment_error(coloured, truth, Environment("factor a channel")) == pytest.approx(0, abs=1e-9)


def test_after_one_factor_the_error_is_the_sine_squared_of_the_maps() -> None:
    """cos of the two as functions on the sphere, the angle integrated by quadrature over cos(theta)."""
    height = 512
    polar = (torch.arange(height, dtype=torch.float64) + 0.5) * (math.pi / height)
    truth = polar.cos().abs()[:, None, None].expand(height, 2, 3)
    estimate = polar.sin()[:, None, None].expand(height, 2, 3)
    # int |c| s dw = 4 pi / 3, int c^2 dw = 4 pi / 3, int s^2 dw = 8 pi / 3.
    expected = 1 - (4 / 3) ** 2 / ((4 / 3) * (8 / 3))
    assert environment_error(estimate, truth, Environment("one factor")) == pytest.approx(expected, abs=1e-4)


def test_an_error_at_the_pole_counts_by_its_solid_angle() -> None:
    truth = torch.ones(64, 128, 3)
    top, middle = truth.clone(), truth.clone()
    top[0], middle[32] = 2, 2
    share = (1 - math.cos(math.pi / 64)) / 2
    assert environment_error(top, truth) == pytest.approx(share, rel=1e-6)
    assert environment_error(middle, truth) > 30 * environment_error(top, truth)


def test_a_black_truth_has_no_figure_and_sizes_must_agree() -> None:
    found = protocol("default").score_environment(light(), torch.zeros(16, 32, 3))
    assert (found["error"].value, found["error"].reason) == (None, "the true light is black")
    with pytest.raises(UsageError, match="cannot be compared"):
        environment_error(light(8), light(16))
