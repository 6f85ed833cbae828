import warnings

import numpy as np
import pytest
import torch

from radiogs_core.scene.colour import DISPLAY_KNEE, LINEAR_KNEE, srgb_decode, srgb_encode

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # it warns of optional packages that it would also like
    import colour

VALUES = torch.tensor([0.0, 1e-12, 1e-4, LINEAR_KNEE, 0.0032, 0.04, DISPLAY_KNEE, 0.05, 0.5, 1.0], dtype=torch.float64)


def test_transfer_functions_are_colour_sciences() -> None:
    """To 1e-7: the standard's rounded constants leave a step of 3e-8 at the knee, where either branch may be taken."""
    np.testing.assert_allclose(srgb_encode(VALUES).numpy(), colour.models.eotf_inverse_sRGB(VALUES.numpy()), atol=1e-7)
    np.testing.assert_allclose(srgb_decode(VALUES).numpy(), colour.models.eotf_sRGB(VALUES.numpy()), atol=1e-7)


def test_decoding_undoes_encoding_also_beyond_display_white() -> None:
    values = torch.logspace(-6, 4, 200, dtype=torch.float64)
    torch.testing.assert_close(srgb_decode(srgb_encode(values)), values, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("value", [-1e-3, 0.0, 1e-12, LINEAR_KNEE])
def test_slope_at_and_below_the_knee_is_finite(value: float) -> None:
    linear = torch.tensor(value, dtype=torch.float64, requires_grad=True)
    srgb_encode(linear).backward()
    assert linear.grad is not None
    assert float(linear.grad) == pytest.approx(12.92)
