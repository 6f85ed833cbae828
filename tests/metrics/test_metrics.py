"""Metrics against scikit-image, closed forms and the published LPIPS figures."""

import math

import cv2
import numpy as np
import pytest
import torch
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from radiogs.errors import NumericalFailure, UsageError
from radiogs_bench.metrics import PSNR_CAP, Value, protocol
from radiogs_bench.metrics.albedo import albedo_scale
from radiogs_bench.metrics.lpips import lpips
from radiogs_bench.metrics.normals import normal_mae
from radiogs_bench.metrics.psnr import psnr
from radiogs_bench.metrics.ssim import ssim
from radiogs_bench.metrics.values import mean


def pair(size: int = 32) -> tuple[torch.Tensor, torch.Tensor]:
    first = torch.rand(size, size + 3, 3)
    return first, (first + 0.1 * torch.randn_like(first)).clamp(0, 1)


def test_psnr_is_scikit_images() -> None:
    image, target = pair()
    expected = peak_signal_noise_ratio(target.double().numpy(), image.double().numpy(), data_range=1)
    assert psnr(image, target) == pytest.approx(expected, abs=1e-9)


def test_ssim_is_scikit_images_with_wangs_settings() -> None:
    image, target = pair()
    expected = structural_similarity(
        image.double().numpy(), target.double().numpy(), channel_axis=2, data_range=1, gaussian_weights=True,
        sigma=1.5, use_sample_covariance=False,
    )  # fmt: skip
    assert ssim(image, target) == pytest.approx(expected, abs=1e-6)


def test_identical_images_are_capped_not_infinite() -> None:
    image, _ = pair()
    assert psnr(image, image) == PSNR_CAP
    assert ssim(image, image) == pytest.approx(1, abs=1e-12)


def test_a_nan_is_an_error_and_not_a_score() -> None:
    image, target = pair()
    image[3, 4, 1] = math.nan
    with pytest.raises(NumericalFailure):
        psnr(image, target)


def test_images_smaller_than_the_window_are_an_error_or_not_available() -> None:
    small = torch.rand(7, 7, 3)
    with pytest.raises(UsageError, match="11"):
        ssim(small, small)
    score = protocol("default").score_image(small, small)["ssim"]
    assert score.value is None
    assert "11" in score.reason


@pytest.mark.parametrize("degrees", [0.0, 1e-4, 0.05, 10, 90, 179.9, 180])
def test_normal_error_is_exact_at_every_angle_and_ignores_length(degrees: float) -> None:
    angle = math.radians(degrees)
    target = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64).expand(4, 4, 3)
    normal = 7 * torch.tensor([math.sin(angle), 0.0, math.cos(angle)], dtype=torch.float64).expand(4, 4, 3)
    assert normal_mae(normal, target, torch.ones(4, 4, 1)) == pytest.approx(degrees, abs=1e-6)


def test_normals_outside_the_mask_do_not_count_and_holes_count_ninety() -> None:
    target = torch.tensor([0.0, 0.0, 1.0]).expand(2, 2, 3)
    normal = target.clone()
    normal[0, 0] = math.nan
    normal[1, 1] = 0
    mask = torch.ones(2, 2, 1)
    mask[0, 0] = 0
    assert normal_mae(normal, target, mask) == pytest.approx(30)
    empty = protocol("default").normal_mae(normal, target, torch.zeros(2, 2, 1))
    assert empty.value is None
    assert "empty" in empty.reason


def test_albedo_scale_is_the_median_ratio_per_channel_whatever_a_few_outliers_say() -> None:
    prediction = 0.1 + 0.5 * torch.rand(20, 20, 3)
    truth = prediction * torch.tensor([2.0, 0.5, 1.5])
    truth[0, :4] = 1000.0
    found = albedo_scale([prediction], [truth], [torch.ones(20, 20, 1)])
    torch.testing.assert_close(found, torch.tensor([2.0, 0.5, 1.5]))
    assert albedo_scale([prediction], [truth], [torch.zeros(20, 20, 1)]).tolist() == [1, 1, 1]


def test_a_mean_over_something_missing_is_missing_with_its_reason() -> None:
    assert mean([Value(1.0), Value(2.0)]).value == 1.5
    assert mean([Value(1.0), Value(None, "because")]) == Value(None, "because")
    assert mean([]).value is None


def test_an_unknown_protocol_is_told_its_neighbours() -> None:
    with pytest.raises(UsageError, match="Did you mean 'default'"):
        protocol("defualt")


@pytest.mark.parametrize(("other", "expected"), [("ex_p0", 0.721881), ("ex_p1", 0.137566), ("ex_ref", 0.0)])
def test_lpips_gives_the_published_distances(
    shared_data, monkeypatch: pytest.MonkeyPatch, other: str, expected: float
) -> None:
    monkeypatch.setenv("RADIOGS_BENCH_WEIGHTS", str(shared_data / "lpips"))

    def read(name: str) -> torch.Tensor:
        image = cv2.imread(str(shared_data / "lpips" / "imgs" / f"{name}.png"))
        assert image is not None
        return torch.from_numpy(np.ascontiguousarray(image[..., ::-1])).float() / 255

    assert lpips(read("ex_ref"), read(other)) == pytest.approx(expected, abs=1e-4)


def test_without_weights_lpips_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    monkeypatch.setenv("RADIOGS_BENCH_WEIGHTS", str(tmp_path))
    image, target = pair()
    score = protocol("default").score_image(image, target)["lpips"]
    assert score.value is None
    assert str(tmp_path) in score.reason
