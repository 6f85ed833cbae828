"""Depth without a scale: by hand on four pixels."""

import math

import pytest
import torch

from radiogs_bench.scoring.metrics.conventions import DepthOffset
from radiogs_bench.scoring.metrics.geometry import depth_offset

RULES = DepthOffset()
TRUTH = torch.tensor([[2.0, 3.0], [4.0, 5.0]])[..., None]
MASK = torch.tensor([[1.0, 0.6], [0.4, 0.0]])[..., None]


def test_the_mean_distance_inside_the_mask_in_percent_of_the_extent() -> None:
    found = TRUTH + torch.tensor([[0.1, -0.3], [9.0, 9.0]])[..., None]
    assert depth_offset(found, TRUTH, MASK, 2.0, RULES) == pytest.approx(100 * 0.2 / 2, rel=1e-6)


def test_a_factor_is_an_error_here_and_an_empty_pixel_the_whole_distance() -> None:
    assert depth_offset(2 * TRUTH, TRUTH, MASK, 1.0, RULES) == pytest.approx(250.0)
    assert depth_offset(0 * TRUTH, TRUTH, MASK, 1.0, RULES) == pytest.approx(250.0)


def test_without_a_covered_pixel_there_is_no_value() -> None:
    assert math.isnan(depth_offset(TRUTH, TRUTH, 0 * MASK, 1.0, RULES))
