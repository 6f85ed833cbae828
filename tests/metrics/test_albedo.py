"""Albedo alignment against NumPy's medians and least squares, its equivariance and its degenerate cases."""

import numpy as np
import pytest
import torch

from radiogs_bench.scoring.metrics.albedo import albedo_scale, encoded, fitted_views, least_squares
from radiogs_bench.scoring.metrics.conventions import Albedo

TRUE_SCALE = torch.tensor([2.0, 0.5, 1.5])
ALIGNMENTS = ("first channel's median", "median", "mean", "least squares")


def views(count: int = 3) -> tuple[list[torch.Tensor], list[torch.Tensor], list[torch.Tensor]]:
    """Noisy predictions of truth / TRUE_SCALE; masks with empty, soft and full pixels."""
    predictions = [0.1 + 0.5 * torch.rand(9, 11, 3) for _ in range(count)]
    truths = [image * TRUE_SCALE * (1 + 0.1 * torch.randn_like(image)) for image in predictions]
    masks = [(2 * torch.rand(9, 11, 1) - 0.5).clamp(0, 1) for _ in range(count)]
    return predictions, truths, masks


def gathered(images: list[torch.Tensor], masks: list[torch.Tensor], threshold: float) -> np.ndarray:
    kept = [image[mask[..., 0] > threshold] for image, mask in zip(images, masks, strict=True)]
    return torch.cat(kept).double().numpy()


@pytest.mark.parametrize("align", ALIGNMENTS)
@pytest.mark.parametrize(("pixels", "threshold"), [("solid", 0.5), ("covered", 0.0), ("covered, any truth", 0.0)])
def test_factors_are_numpys(align: str, pixels: str, threshold: float) -> None:
    predictions, truths, masks = views()
    ours, theirs = gathered(predictions, masks, threshold), gathered(truths, masks, threshold)
    ratios = theirs / ours
    lower_median = np.sort(ratios, 0)[(len(ratios) - 1) // 2]
    expected = {
        "first channel's median": [lower_median[0]] * 3,
        "median": lower_median,
        "mean": ratios.mean(0),
        "least squares": [np.linalg.lstsq(ours[:, c : c + 1], theirs[:, c], rcond=None)[0][0] for c in range(3)],
    }[align]
    found = albedo_scale(predictions, truths, masks, Albedo(align=align, pixels=pixels))
    assert found.tolist() == pytest.approx(list(expected), rel=1e-5)


@pytest.mark.parametrize("align", ALIGNMENTS)
def test_a_scaled_prediction_has_the_inverse_factor(align: str) -> None:
    predictions, truths, masks = views()
    rules = Albedo(align=align)
    once = albedo_scale(predictions, truths, masks, rules)
    fourfold = albedo_scale([4 * image for image in predictions], truths, masks, rules)
    torch.testing.assert_close(4 * fourfold, once)


def test_a_hundredth_of_outliers_moves_the_median_by_little() -> None:
    prediction = 0.1 + 0.5 * torch.rand(20, 50, 3)
    truth = prediction * TRUE_SCALE
    truth[0, :10] = 1000.0
    found = albedo_scale([prediction], [truth], [torch.ones(20, 50, 1)])
    torch.testing.assert_close(found, TRUE_SCALE)


def test_a_channel_that_is_zero_stays_finite() -> None:
    predictions, truths, masks = views()
    for image in predictions:
        image[..., 1] = 0
    for align in ALIGNMENTS:
        assert albedo_scale(predictions, truths, masks, Albedo(align=align)).isfinite().all()
    zero = torch.zeros(5, 3)
    assert least_squares(zero, torch.rand(5, 3)).tolist() == [0, 0, 0]


def test_least_squares_may_be_negative_and_says_so() -> None:
    assert least_squares(torch.tensor([[1.0], [2.0]]), torch.tensor([[-2.0], [-4.0]])).item() == pytest.approx(-2)


def test_without_pixels_the_alignment_factor_is_one() -> None:
    predictions, truths, masks = views()
    for rules in (Albedo(), Albedo(align="none"), Albedo(align="least squares")):
        assert albedo_scale(predictions, truths, [0 * mask for mask in masks], rules).tolist() == [1, 1, 1]
    assert albedo_scale([], [], []).tolist() == [1, 1, 1]


def test_the_views_that_are_fitted() -> None:
    assert fitted_views(200, Albedo()) == list(range(200))
    assert fitted_views(200, Albedo(fitted_to="first view")) == [0]
    assert fitted_views(200, Albedo(fitted_to="20 views")) == list(range(0, 200, 10))
    assert fitted_views(47, Albedo(fitted_to="20 views")) == [2 * place for place in range(20)]
    assert fitted_views(7, Albedo(fitted_to="20 views")) == list(range(7))


def test_svg_irs_rule_looks_at_predicted_pixels_and_bounds_each_ratio() -> None:
    prediction, truth = torch.zeros(1, 5, 3), torch.full((1, 5, 3), 0.8)
    prediction[0, :3] = torch.tensor([0.4, 0.001, 0.8])
    rules = Albedo(pixels="predicted", largest=10.0)
    assert albedo_scale([prediction], [truth], [torch.zeros(1, 5, 1)], rules).tolist() == pytest.approx([2, 10, 1])


def test_nan_outside_the_mask_does_not_leak() -> None:
    predictions, truths, masks = views()
    expected = albedo_scale(predictions, truths, masks)
    for prediction, truth, mask in zip(predictions, truths, masks, strict=True):
        prediction[mask[..., 0] == 0] = torch.nan
        truth[mask[..., 0] == 0] = torch.nan
    assert torch.equal(albedo_scale(predictions, truths, masks), expected)


def test_encodings() -> None:
    linear = torch.tensor([[[0.0, 0.5, 1.0]]])
    assert encoded(linear, "linear") is linear
    assert encoded(linear, "gamma 2.2").flatten().tolist() == pytest.approx([0, 0.5 ** (1 / 2.2), 1])
    assert encoded(linear, "srgb").flatten().tolist() == pytest.approx([0, 1.055 * 0.5 ** (1 / 2.4) - 0.055, 1])
