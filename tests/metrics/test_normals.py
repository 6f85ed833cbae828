"""Normal errors at every angle, under every region."""

import math

import pytest
import torch

from radiogs_bench.scoring.metrics.conventions import Normal
from radiogs_bench.scoring.metrics.geometry import angle, normal_mae
from radiogs_bench.scoring.metrics.protocols import protocol

IMAGE = Normal(region="image")


def towards(*, degrees: float, size: int = 4) -> torch.Tensor:
    radians = math.radians(degrees)
    direction = torch.tensor([math.sin(radians), 0.0, math.cos(radians)], dtype=torch.float64)
    return direction.expand(size, size, 3).clone()


@pytest.mark.parametrize("degrees", [0.0, 1e-5, 1e-3, 0.05, 30, 90, 179.999, 180])
@pytest.mark.parametrize("length", [1e-3, 1.0, 7.0])
def test_the_angle_is_exact_from_identical_to_anti_parallel(degrees: float, length: float) -> None:
    found = angle(length * towards(degrees=degrees), towards(degrees=0.0))
    assert (found - degrees).abs().max() < math.degrees(1e-6)


def test_identical_float32_normals_are_at_no_angle() -> None:
    """Where arccos of their dot products, clamped, would say 0.002 degrees, and NaN unclamped."""
    normal = torch.nn.functional.normalize(torch.randn(50, 50, 3), dim=-1)
    assert angle(normal, normal).max() < 1e-6


def test_a_whole_image_counts_the_background_as_right() -> None:
    """8 degrees in a 25 % mask are 2 degrees over the image."""
    target, normal, mask = torch.zeros(4, 4, 3), torch.zeros(4, 4, 3), torch.zeros(4, 4, 1)
    mask[:2, :2] = 1
    target[:2, :2], normal[:2, :2] = towards(degrees=20, size=2).float(), towards(degrees=28, size=2).float()
    assert normal_mae(normal, target, mask, mask) == pytest.approx(8, abs=1e-5)
    assert normal_mae(normal, target, mask, mask, IMAGE) == pytest.approx(2, abs=1e-5)


def test_floaters_count_by_their_own_coverage_but_not_by_the_truths() -> None:
    target, mask = towards(degrees=0), torch.ones(4, 4, 1)
    mask[2:] = 0
    normal = towards(degrees=0)
    normal[2:] = torch.tensor([1.0, 0.0, 0.0])
    alpha = torch.ones(4, 4, 1)
    assert normal_mae(normal, target, mask, alpha, IMAGE) == pytest.approx(45)
    by_truth = Normal(region="image", blended_by="true coverage")
    assert normal_mae(normal, target, mask, alpha, by_truth) == pytest.approx(0, abs=1e-6)


def test_a_silhouette_is_blended_halfway_to_the_background() -> None:
    """(1, 0, 0) at half coverage over (0, 0, 1) stands at 45 degrees."""
    sideways = torch.tensor([1.0, 0.0, 0.0]).expand(2, 2, 3)
    half, full = torch.full((2, 2, 1), 0.5), torch.ones(2, 2, 1)
    assert normal_mae(sideways, sideways, full, half, IMAGE) == pytest.approx(45)


def test_holes_count_ninety_where_they_are_covered() -> None:
    target, normal, mask = towards(degrees=0), towards(degrees=0), torch.ones(4, 4, 1)
    normal[0] = 0
    assert normal_mae(normal, target, mask) == pytest.approx(22.5)
    alpha = torch.ones(4, 4, 1)
    assert normal_mae(normal, target, mask, alpha, IMAGE) == pytest.approx(22.5)
    alpha[0] = 0  # neither normal nor coverage: the background stands there
    assert normal_mae(normal, target, mask, alpha, IMAGE) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("rules", [Normal(), IMAGE, Normal(region="image", blended_by="true coverage")])
def test_nan_outside_the_mask_does_not_leak_and_an_empty_mask_has_no_figure(rules: Normal) -> None:
    target, normal, mask = towards(degrees=0), towards(degrees=10), torch.ones(4, 4, 1)
    mask[0], normal[0], target[0] = 0, math.nan, math.nan
    assert math.isfinite(normal_mae(normal, target, mask, mask, rules))
    assert math.isnan(normal_mae(normal, target, torch.zeros(4, 4, 1), mask, rules))


def test_eight_bits_cost_a_fifth_of_a_degree() -> None:
    normal = torch.nn.functional.normalize(torch.randn(60, 60, 3), dim=-1)
    mask = torch.ones(60, 60, 1)
    rounded = normal_mae(normal, normal, mask, mask, Normal(region="image", prediction_bits="8 bit rounded"))
    assert rounded == pytest.approx(0.17, abs=0.02)


def test_a_protocol_says_that_its_mask_is_empty() -> None:
    found = protocol("default").score_normal(towards(degrees=0), towards(degrees=0), torch.zeros(4, 4, 1))["mae"]
    assert (found.value, found.reason) == (None, "the mask is empty")
