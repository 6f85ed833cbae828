"""CIEDE2000 of albedo against scikit-image's, and where it is measured."""

import subprocess
import sys

import numpy as np
import pytest
import torch
from skimage.color import deltaE_ciede2000, rgb2lab

from radiogs_bench.scoring.metrics.albedo import ciede2000
from radiogs_bench.scoring.metrics.protocols import PROTOCOLS, protocol
from radiogs_core.scene.colour import srgb_encode

ONES, WHOLE = torch.ones(3), torch.ones(16, 16, 1)


def image(seed: int) -> torch.Tensor:
    return torch.rand(16, 16, 3, generator=torch.Generator().manual_seed(seed))


def test_it_is_that_of_an_independent_library() -> None:
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
    """In a process of its own, since a library is imported once."""
    lines = (
        "import numpy as np, torch",
        "from radiogs_bench.scoring.metrics.albedo import ciede2000",
        "ciede2000(torch.ones(2, 2, 3), torch.zeros(2, 2, 3), torch.ones(2, 2, 1))",
        "print(np.get_printoptions()['legacy'], np.float64(2 / 3))",
    )
    printed = subprocess.run([sys.executable, "-c", "\n".join(lines)], capture_output=True, text=True, check=True)
    assert printed.stdout == "False 0.6666666666666666\n"
