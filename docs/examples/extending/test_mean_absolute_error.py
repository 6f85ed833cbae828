"""The mean absolute error of two small images, worked out by hand."""

import pytest
import torch

from radiogs_bench.scoring.metrics.protocols import protocol
from radiogs_bench.suites.suite import Metric


def test_it_is_the_mean_over_pixels_and_channels() -> None:
    image, target = torch.zeros(8, 8, 3), torch.zeros(8, 8, 3)
    image[0, 0], target[0, 0] = torch.tensor([0.5, 0.0, 0.25]), torch.tensor([0.0, 0.25, 0.0])
    assert protocol("default").score_image(image, target)["l1"].value == pytest.approx(1.0 / (8 * 8 * 3))


def test_it_can_be_a_column() -> None:
    assert Metric("nvs", "l1").label == "NVS L1"
