"""Backgrounds, masks and 8 bits, against compositing written out from straight colours."""

import math

import pytest
import torch

from radiogs_bench.scoring.metrics.conventions import Picture
from radiogs_bench.scoring.metrics.pictures import in_bits, predicted, straight, times, true

COLOUR = torch.rand(5, 6, 3, generator=torch.Generator().manual_seed(1))
OWN = torch.rand(5, 6, 1, generator=torch.Generator().manual_seed(2))
MASK = torch.rand(5, 6, 1, generator=torch.Generator().manual_seed(3))
MASK[0], OWN[1] = 0.0, 0.0


@pytest.mark.parametrize(
    ("rules", "expected"),
    [
        (Picture(), COLOUR * OWN),
        (Picture(background="white"), COLOUR * OWN + 1 - OWN),
        (Picture(prediction="times true coverage"), COLOUR * OWN * MASK),
        (Picture(prediction="solid"), torch.where(OWN > 0.5, COLOUR, 0.0)),
        (Picture(background="white", prediction="solid"), torch.where(OWN > 0.5, COLOUR, 1.0)),
        (
            Picture(background="white", prediction="background outside truth"),
            torch.where(MASK > 0, COLOUR * OWN + 1 - OWN, 1.0),
        ),
    ],
)
def test_predictions_are_laid_out(rules: Picture, expected: torch.Tensor) -> None:
    torch.testing.assert_close(predicted(COLOUR * OWN, OWN, MASK, rules), expected)


@pytest.mark.parametrize(
    ("rules", "expected"),
    [
        (Picture(), COLOUR * MASK),
        (Picture(background="white"), COLOUR * MASK + 1 - MASK),
        (Picture(target="times coverage again"), COLOUR * MASK**2),
        (Picture(target="straight"), torch.where(MASK > 0, COLOUR, 0.0)),
    ],
)
def test_truths_are_laid_out(rules: Picture, expected: torch.Tensor) -> None:
    torch.testing.assert_close(true(COLOUR * MASK, MASK, rules), expected)


def test_the_scale_comes_after_the_bytes_and_before_the_clipping() -> None:
    image, ones = torch.full((2, 2, 3), 0.4999), torch.ones(2, 2, 1)
    scale = torch.tensor([1.0, 1.5, 3.0])
    rules = Picture(prediction_bits="8 bit rounded", clipped=True)
    expected = torch.tensor([127 / 255, 1.5 * 127 / 255, 1.0]).expand(2, 2, 3)
    torch.testing.assert_close(predicted(image, ones, ones, rules, scale), expected)


def test_every_byte_survives_both_ways_into_eight_bits() -> None:
    levels = torch.arange(256)[:, None, None] / 255
    for bits in ("8 bit rounded", "8 bit truncated"):
        assert torch.equal(in_bits(levels, bits), levels)


def test_rounding_is_half_a_level_off_at_most_and_truncation_never_brightens() -> None:
    image = torch.rand(40, 40, 3)
    assert (in_bits(image, "8 bit rounded") - image).abs().max() <= 0.5001 / 255
    lower = in_bits(image, "8 bit truncated") - image
    assert -1 / 255 < lower.min() < lower.max() <= 1e-6
    assert torch.equal(in_bits(torch.tensor([[[-1.0, 2.0]]]), "8 bit rounded"), torch.tensor([[[0.0, 1.0]]]))


def test_nan_outside_a_mask_does_not_come_through() -> None:
    image, mask = torch.rand(3, 3, 3), torch.zeros(3, 3, 1)
    mask[1, 1] = 0.5
    image[0, 0] = math.nan
    assert torch.equal(times(image, mask), image.nan_to_num() * mask)
    for rules in (Picture(prediction="times true coverage"), Picture(prediction="background outside truth")):
        assert predicted(image, mask, mask, rules).isfinite().all()
    assert straight(image, mask)[0, 0].tolist() == [0, 0, 0]
