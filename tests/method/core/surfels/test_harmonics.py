"""Spherical harmonics against SciPy's complex ones."""

import numpy as np
import torch
from scipy.special import sph_harm_y

from radiogs_core.surfels.harmonics import surfel_radiance
from reference.trace import harmonics


def _unit(count: int) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.randn(count, 3, dtype=torch.float64), dim=-1)


def test_basis_is_scipys_up_to_the_sign_order_of_3dgs() -> None:
    direction = _unit(50)
    polar = np.arccos(direction[:, 2].numpy())
    azimuth = np.arctan2(direction[:, 1].numpy(), direction[:, 0].numpy())
    expected = []
    for degree in range(4):
        for order in range(-degree, degree + 1):
            value = sph_harm_y(degree, abs(order), polar, azimuth)
            # SciPy keeps the Condon-Shortley phase, as 3DGS's signs do.
            part = value.imag if order < 0 else value.real
            expected.append(part * (1 if order == 0 else np.sqrt(2)))
    np.testing.assert_allclose(harmonics(direction).numpy(), np.stack(expected, -1), atol=1e-12)


def test_radiance_is_never_negative_and_uses_the_direction_of_travel() -> None:
    sh = torch.zeros(1, 4, 3)
    sh[0, 2] = 1.0  # the z harmonic
    up = torch.tensor([[0.0, 0.0, 1.0]])
    assert (surfel_radiance(sh, up) < 0.5).all()
    assert (surfel_radiance(sh, -up) > 0.5).all()
    assert (surfel_radiance(-10 * sh, -up) == 0).all()
