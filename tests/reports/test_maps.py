"""Maps as pictures: the transfer function against colour-science, errors against closed forms."""

import colour
import numpy as np
import pytest

from radiogs_reports.maps import ANGLE_RANGE, ERROR_RANGE, display, error, levels, linear


def test_display_is_srgb_and_linear_its_inverse() -> None:
    values = np.linspace(0, 1, 1001)[:, None, None]
    assert display(values) == pytest.approx(colour.models.eotf_inverse_sRGB(values), abs=1e-12)
    assert linear(display(values)) == pytest.approx(values, abs=2e-7)  # the standard's two pieces meet to 1e-7


def test_the_error_of_normals_is_their_angle() -> None:
    degrees = np.array([0.0, 1e-4, 10.0, 44.0, 90.0, 180.0])
    angles = np.radians(degrees)
    mine = np.stack([np.cos(angles), np.sin(angles), 0 * angles], -1)[None]
    theirs = np.broadcast_to([1.0, 0.0, 0.0], mine.shape)
    expected = np.minimum(degrees / ANGLE_RANGE, 1)
    assert error("normal", mine, theirs)[0, :, 0] == pytest.approx(expected, abs=1e-9)


def test_a_normal_without_true_surface_has_the_full_error() -> None:
    surface, nothing = np.array([[[0.0, 0.0, 1.0]]]), np.zeros((1, 1, 3))
    assert error("normal", surface, nothing) == 1
    assert error("normal", nothing, surface) == 1
    assert error("normal", nothing, nothing) == 0


def test_the_error_of_colours_is_the_mean_difference_as_displayed_and_clipped() -> None:
    mine, theirs = np.array([[[0.5, 0.25, 3.0]]]), np.array([[[0.4, 0.25, 1.0]]])
    assert error("image", mine, theirs) == pytest.approx(0.1 / 3 / ERROR_RANGE)


def test_a_single_channel_is_shown_grey() -> None:
    assert levels(np.array([[[0.5]]])).tolist() == [[[128, 128, 128]]]
