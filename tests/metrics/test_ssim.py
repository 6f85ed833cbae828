"""SSIM in its variants against scikit-image, torchmetrics and the measured table of facts."""

import math

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter
from skimage import data
from skimage.metrics import structural_similarity
from torchmetrics.functional.image import structural_similarity_index_measure

from metrics.images import example
from radiogs_bench.scoring.metrics.conventions import Ssim
from radiogs_bench.scoring.metrics.protocols import protocol
from radiogs_bench.scoring.metrics.ssim import WANG, ssim
from radiogs_bench.scoring.metrics.stanford_orb import ORB_SSIM
from radiogs_core.errors import UsageError

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
