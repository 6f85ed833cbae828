"""Pictures: their layout, PSNR, SSIM and colour differences, and means over views."""

import math
import subprocess
import sys

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter
from skimage import data
from skimage.color import deltaE_ciede2000, rgb2lab
from skimage.metrics import peak_signal_noise_ratio, structural_similarity
from torchmetrics.functional.image import structural_similarity_index_measure

from metrics.images import example
from radiogs_bench.scoring.metrics.albedo import ciede2000
from radiogs_bench.scoring.metrics.conventions import Picture, Psnr, Ssim
from radiogs_bench.scoring.metrics.pictures import in_bits, predicted, straight, times, true
from radiogs_bench.scoring.metrics.protocols import PROTOCOLS, protocol
from radiogs_bench.scoring.metrics.psnr import decibel, error_of, masked_mse, mse, psnr
from radiogs_bench.scoring.metrics.ssim import WANG, ssim
from radiogs_bench.scoring.metrics.stanford_orb import ORB_SSIM
from radiogs_bench.scoring.metrics.values import PSNR_CAP, Value, mean
from radiogs_core.errors import NumericalFailure, UsageError
from radiogs_core.scene.colour import srgb_encode

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


def test_pixels_outside_a_mask_do_not_count_even_if_nan() -> None:
    image, target, mask = torch.rand(8, 8, 1), torch.rand(8, 8, 1), torch.zeros(8, 8, 1)
    mask[2, 3] = 1
    image[0, 0], target[7, 7] = math.nan, math.inf
    assert masked_mse(image, target, mask) == pytest.approx(float(image[2, 3] - target[2, 3]) ** 2, rel=1e-5)
    assert math.isnan(masked_mse(image, target, torch.zeros(8, 8, 1)))


SPLATTING = Ssim(padding="zero")
GAUSS_SAMPLE = Ssim(covariance="sample")
UNIFORM = Ssim(window=7, taps="uniform", covariance="sample")
REFLECT = Ssim(padding="reflect")


def noisy(image: torch.Tensor, sigma: float) -> torch.Tensor:
    return (image + sigma * torch.randn_like(image)).clamp(0, 1)


def astronaut() -> torch.Tensor:
    return torch.from_numpy(data.astronaut()[60:220, 140:310] / 255)


PAIRS = {
    "random": lambda: (torch.rand(40, 53, 3).double(), torch.rand(40, 53, 3).double()),
    "natural, noisy": lambda: (astronaut(), noisy(astronaut(), 0.05)),
    "natural, blurred": lambda: (astronaut(), torch.from_numpy(gaussian_filter(astronaut().numpy(), (1, 1, 0)))),
    "natural, dark": lambda: (0.05 * astronaut(), noisy(0.05 * astronaut(), 0.005)),
    "one channel": lambda: (astronaut()[..., :1], noisy(astronaut()[..., :1], 0.1)),
}


@pytest.fixture(params=PAIRS)
def pair(request: pytest.FixtureRequest) -> tuple[torch.Tensor, torch.Tensor]:
    return PAIRS[request.param]()


@pytest.mark.parametrize(
    ("rules", "settings"),
    [
        (WANG, {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}),
        (GAUSS_SAMPLE, {"gaussian_weights": True, "sigma": 1.5}),
        (UNIFORM, {}),
        (Ssim(window=7, taps="uniform"), {"use_sample_covariance": False}),
        (Ssim(window=7, taps="uniform", covariance="sample", data_range=2.0), {"data_range": 2}),
    ],
)
def test_variants_are_scikit_images(pair: tuple[torch.Tensor, torch.Tensor], rules: Ssim, settings: dict) -> None:
    image, target = pair
    expected = structural_similarity(
        target.numpy(), image.numpy(), channel_axis=2, **({"data_range": 1} | settings)
    )  # fmt: skip
    assert ssim(image, target, rules) == pytest.approx(expected, abs=1e-9)


def test_reflected_windows_are_torchmetrics(pair: tuple[torch.Tensor, torch.Tensor]) -> None:
    batches = [side.permute(2, 0, 1)[None] for side in pair]
    expected = structural_similarity_index_measure(batches[0], batches[1], data_range=1.0)
    assert ssim(*pair, REFLECT) == pytest.approx(float(expected), abs=1e-9)


def test_bounded_covariances_change_nothing_in_float64(pair: tuple[torch.Tensor, torch.Tensor]) -> None:
    assert ssim(*pair, Ssim(bounded=True)) == pytest.approx(ssim(*pair, WANG), abs=1e-12)


@pytest.mark.parametrize("rules", [SPLATTING, ORB_SSIM])
def test_padded_variants_are_a_sum_over_windows_written_out(rules: Ssim) -> None:
    """Every window gathered by itself, its moments as weighted sums about the mean: no convolution."""
    image, target = (torch.rand(9, 8, 1).double() for _ in range(2))
    reach = rules.window // 2
    offset = np.arange(-reach, reach + 1)
    weight = np.exp(-(offset[:, None] ** 2 + offset[None] ** 2) / (2 * 1.5**2))
    weight /= weight.sum()
    mode = {"mode": "reflect"} if rules.padding == "reflect" else {"mode": "constant"}
    x, y = (np.pad(side[..., 0].numpy(), reach, **mode) for side in (image, target))
    total = []
    for row in range(9):
        for column in range(8):
            a, b = (side[row : row + rules.window, column : column + rules.window] for side in (x, y))
            ma, mb = (weight * a).sum(), (weight * b).sum()
            va, vb = (weight * (a - ma) ** 2).sum(), (weight * (b - mb) ** 2).sum()
            ab = (weight * (a - ma) * (b - mb)).sum()
            total.append((2 * ma * mb + 1e-4) * (2 * ab + 9e-4) / ((ma**2 + mb**2 + 1e-4) * (va + vb + 9e-4)))
    assert ssim(image, target, rules) == pytest.approx(np.mean(total), abs=1e-12)


COLUMNS = (
    SPLATTING,
    Ssim(bounded=True),
    WANG,
    GAUSS_SAMPLE,
    UNIFORM,
    REFLECT,
    ORB_SSIM,
    Ssim(window=7, taps="uniform", covariance="sample", data_range=2.0),
    Ssim(padding="zero", data_range=255.0),
)
"""3DGS | mip-NeRF, TensoIR | scikit-image Wang | its sample covariance | its default | torchmetrics | Stanford-ORB |
L = 2 by mistake | L = 255 by mistake."""

MEASURED = {
    "ex_p0": (0.5272, 0.4367, 0.4367, 0.4364, 0.4769, 0.4501, 0.4409, 0.5559, 0.9994),
    "ex_p1": (0.3734, 0.2959, 0.2959, 0.2955, 0.3132, 0.2859, 0.3007, 0.3860, 0.9976),
    "blur": (0.8322, 0.7969, 0.7969, 0.7968, 0.8249, 0.8083, 0.7239, 0.8499, 0.9999),
    "+0.05": (0.9832, 0.9879, 0.9879, 0.9879, 0.9871, 0.9819, 0.9749, 0.9888, 0.9997),
    "astronaut blur": (0.9272, 0.9251),
}
"""The table of measured figures, to its four digits; its noisy pairs were drawn elsewhere."""


@pytest.mark.parametrize("name", MEASURED)
def test_the_measured_table_is_reproduced(shared_data, name: str) -> None:
    if name == "astronaut blur":
        target = torch.from_numpy(data.astronaut() / 255)
    else:
        target = example(shared_data, "ex_ref").double()
    if name.startswith("ex_"):
        image = example(shared_data, name).double()
    elif name == "+0.05":
        image = (target + 0.05).clamp(0, 1)
    else:
        image = torch.from_numpy(gaussian_filter(target.numpy(), (1, 1, 0)))
    assert [round(ssim(image, target, rules), 4) for rules in COLUMNS[: len(MEASURED[name])]] == [*MEASURED[name]]


def test_a_stretched_range_ruins_dark_images_and_a_byte_range_all_of_them() -> None:
    """Why the range is fixed at 1: max - min of a dark render punishes it, 255 forgives everything."""
    dark = 0.05 * astronaut()
    image = noisy(dark, 0.005)
    stretched = Ssim(padding="reflect", data_range=float(max(image.max(), dark.max()) - min(image.min(), dark.min())))
    assert ssim(image, dark, REFLECT) > 0.95
    assert ssim(image, dark, stretched) < 0.5
    assert ssim(torch.rand(32, 32, 3), torch.rand(32, 32, 3), Ssim(data_range=255.0)) > 0.98


@pytest.mark.parametrize("level", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("rules", COLUMNS[:7])
def test_constant_images_have_only_the_luminance_term(level: float, rules: Ssim) -> None:
    """No structure: (2ab + C1) / (a^2 + b^2 + C1), wherever the window lies inside the image."""
    image, target = torch.full((16, 16, 3), level), torch.full((16, 16, 3), 0.5)
    if rules.padding == "zero":
        assert ssim(image, image, rules) == pytest.approx(1, abs=1e-9)
    else:
        a, b = float(image[0, 0, 0]), 0.5
        expected = (2 * a * b + 1e-4) / (a * a + b * b + 1e-4)
        assert ssim(image, target, rules) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("rules", COLUMNS[:7])
@pytest.mark.parametrize("size", [1, 2, 5, 6, 7, 11])
def test_an_image_is_scored_or_named_too_small(rules: Ssim, size: int) -> None:
    image = torch.rand(size, 20, 3)
    if size < {"valid": rules.window, "reflect": rules.window // 2 + 1, "zero": 1}[rules.padding]:
        with pytest.raises(UsageError, match="at least"):
            ssim(image, image, rules)
    else:
        assert ssim(image, image, rules) == pytest.approx(1, abs=1e-9)


def test_small_images_are_not_available_under_a_protocol() -> None:
    found = protocol("default").score_image(torch.rand(7, 7, 3), torch.rand(7, 7, 3))["ssim"]
    assert (found.value, "11" in found.reason) == (None, True)
    assert math.isfinite(protocol("irgs").score_image(torch.rand(7, 7, 3), torch.rand(7, 7, 3))["ssim"].value or 0)


ONES, WHOLE = torch.ones(3), torch.ones(16, 16, 1)


def image(seed: int) -> torch.Tensor:
    return torch.rand(16, 16, 3, generator=torch.Generator().manual_seed(seed))


def test_ciede2000_agrees_with_an_independent_library() -> None:
    ours, theirs = image(0), image(1)
    lab = [rgb2lab(srgb_encode(side).numpy().astype(np.float64)) for side in (theirs, ours)]
    expected = deltaE_ciede2000(*lab)
    assert ciede2000(ours, theirs, WHOLE) == pytest.approx(expected.mean(), rel=2e-3)
    half = (torch.arange(16) < 8).float()[:, None, None].expand(16, 16, 1)
    assert ciede2000(ours, theirs, half) == pytest.approx(expected[:8].mean(), rel=2e-3)


def test_black_is_a_hundred_from_white_and_nothing_is_apart_from_itself() -> None:
    white = torch.ones(16, 16, 3)
    assert ciede2000(0 * white, white, WHOLE) == pytest.approx(100, abs=0.01)
    assert ciede2000(white, white, WHOLE) == 0
    assert ciede2000(2 * white, white, WHOLE) == 0, "an albedo above one is shown as white"
    assert np.isnan(ciede2000(white, white, 0 * WHOLE))


def test_a_hue_that_costs_as_much_squared_error_as_a_grey_is_further_away() -> None:
    """PSNR cannot distinguish a shift of all channels from the same shift of one against the others."""
    grey = torch.full((16, 16, 3), 0.5)
    shift = 0.05 * torch.tensor([1.0, -1.0, 1.0])
    assert ciede2000(grey + shift, grey, WHOLE) > 4 * ciede2000(grey + shift.abs(), grey, WHOLE)


def test_protocol_default_measures_it_of_the_aligned_albedo_and_no_published_one_does() -> None:
    truth = 0.4 * image(2)
    found = protocol("default").score_albedo(truth / 2, truth, 2 * ONES, WHOLE)
    assert found["delta_e"].value == pytest.approx(0, abs=1e-6)
    assert protocol("default").score_albedo(truth, truth, ONES, 0 * WHOLE)["delta_e"].reason == "the mask is empty"
    assert {name for name, rules in PROTOCOLS.items() if rules.albedo.difference != "none"} == {"default"}


def test_the_library_leaves_the_digits_that_numpy_prints() -> None:
    """In a separate process, because a library is imported only once."""
    lines = (
        "import numpy as np, torch",
        "from radiogs_bench.scoring.metrics.albedo import ciede2000",
        "ciede2000(torch.ones(2, 2, 3), torch.zeros(2, 2, 3), torch.ones(2, 2, 1))",
        "print(np.get_printoptions()['legacy'], np.float64(2 / 3))",
    )
    printed = subprocess.run([sys.executable, "-c", "\n".join(lines)], capture_output=True, text=True, check=True)
    assert printed.stdout == "False 0.6666666666666666\n"


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
