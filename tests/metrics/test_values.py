"""Figures that may not exist."""

import math

import pytest
import torch

from radiogs_bench.scoring.metrics.protocols import protocol
from radiogs_bench.scoring.metrics.values import Value, mean
from radiogs_core.errors import NumericalFailure


def test_a_mean_over_something_missing_is_missing_with_its_reason() -> None:
    assert mean([Value(1.0), Value(2.0)]).value == 1.5
    assert mean([Value(1.0), Value(None, "because")]) == Value(None, "because")
    assert mean([]) == Value(None, "no view to score")


def test_a_mean_is_the_same_in_every_order() -> None:
    values = [Value(10.0**place) for place in range(-8, 9)]
    assert mean(values) == mean(values[::-1])


@pytest.mark.parametrize("damage", [math.nan, math.inf])
def test_a_pixel_that_is_no_number_is_an_error_and_not_a_score(damage: float) -> None:
    image, target = torch.rand(16, 16, 3), torch.rand(16, 16, 3)
    target[3, 4, 1] = damage
    with pytest.raises(NumericalFailure, match="not finite"):
        protocol("default").score_image(image, target)
