"""PSNR and mean squared error against scikit-image and closed forms."""

import math

import pytest
import torch
from skimage import data
from skimage.metrics import peak_signal_noise_ratio

from radiogs_bench.scoring.metrics.conventions import Psnr
from radiogs_bench.scoring.metrics.psnr import decibel, error_of, masked_mse, mse, psnr
from radiogs_bench.scoring.metrics.values import PSNR_CAP

BY_CHANNEL = Psnr(channels="mean of channels")


@pytest.mark.parametrize("natural", [False, True])
def test_both_forms_are_scikit_images(natural: bool) -> None:
    target = torch.from_numpy(data.astronaut()[::4, ::4] / 255) if natural else torch.rand(30, 41, 3).double()
    image = (target + torch.tensor([0.01, 0.03, 0.1]) * torch.randn_like(target)).clamp(0, 1)
    joint = peak_signal_noise_ratio(target.numpy(), image.numpy(), data_range=1)
    channels = [peak_signal_noise_ratio(target[..., c].numpy(), image[..., c].numpy(), data_range=1) for c in range(3)]
    assert psnr(image, target) == pytest.approx(joint, abs=1e-9)
    assert psnr(image, target, BY_CHANNEL) == pytest.approx(sum(channels) / 3, abs=1e-9)


def test_the_mean_over_channels_is_never_lower() -> None:
    """Convexity; equal where the channels' errors are equal, 17.8 dB more where one channel has nearly all of it."""
    target = torch.rand(20, 20, 3)
    even = target + 0.1
    assert psnr(even, target, BY_CHANNEL) == pytest.approx(psnr(even, target), abs=1e-4)
    uneven = target + torch.tensor([0.1, 1e-3, 1e-3])
    expected = (20 + 60 + 60) / 3
    assert psnr(uneven, target, BY_CHANNEL) == pytest.approx(expected, abs=1e-3)
    assert psnr(uneven, target) == pytest.approx(20 + 10 * math.log10(3), abs=1e-3)


def test_identical_images_and_channels_are_capped() -> None:
    target = torch.rand(20, 20, 3)
    assert psnr(target, target) == psnr(target, target, BY_CHANNEL) == PSNR_CAP
    one_wrong = target.clone()
    one_wrong[..., 0] += 0.1
    assert psnr(one_wrong, target, BY_CHANNEL) == pytest.approx((20 + 2 * PSNR_CAP) / 3, abs=1e-4)


def test_an_error_and_its_decibels_are_inverse_up_to_the_cap() -> None:
    assert [error_of(decibel(error)) for error in (1.0, 1e-3, 1e-9)] == pytest.approx([1.0, 1e-3, 1e-9])
    assert decibel(0.0) == decibel(1e-30) == PSNR_CAP


def test_ten_million_small_errors_and_a_few_large_ones_are_summed_without_loss() -> None:
    """A running float32 sum would be 1 % low."""
    image = torch.full((2500, 4000, 1), 1e-2)
    image[0, :7] = 1.0
    small = float(torch.tensor(1e-2)) ** 2
    expected = ((10_000_000 - 7) * small + 7) / 10_000_000
    assert mse(image, torch.zeros_like(image)) == pytest.approx(expected, rel=1e-9)


def test_what_lies_outside_a_mask_does_not_count_even_if_it_is_nan() -> None:
    image, target, mask = torch.rand(8, 8, 1), torch.rand(8, 8, 1), torch.zeros(8, 8, 1)
    mask[2, 3] = 1
    image[0, 0], target[7, 7] = math.nan, math.inf
    assert masked_mse(image, target, mask) == pytest.approx(float(image[2, 3] - target[2, 3]) ** 2, rel=1e-5)
    assert math.isnan(masked_mse(image, target, torch.zeros(8, 8, 1)))
