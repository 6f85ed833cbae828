"""K5 against SciPy's rotations and central differences, in float64, and at the ends of float32's range."""

import pytest
import torch
from scipy.spatial.transform import Rotation

from radiogs_core.kernels.surfel.footprint import frames


def quaternions(count: int = 30) -> torch.Tensor:
    return torch.randn(count, 4, dtype=torch.float64)


def test_frames_are_scipys() -> None:
    rotation = quaternions()
    expected = torch.from_numpy(Rotation.from_quat(rotation.numpy(), scalar_first=True).as_matrix())
    torch.testing.assert_close(frames(rotation), expected, rtol=0, atol=1e-14)


def test_gradients_equal_central_differences() -> None:
    assert torch.autograd.gradcheck(frames, (quaternions(8).requires_grad_(),))


def test_a_zero_quaternion_has_neither_frame_nor_gradient() -> None:
    rotation = torch.zeros(2, 4, requires_grad=True)
    found = frames(rotation)
    assert (found == 0).all()
    found.sum().backward()
    assert rotation.grad is not None
    assert (rotation.grad == 0).all()


@pytest.mark.parametrize("length", [1e-37, 1e-20, 1.0, 1e20, 1e38])
def test_the_length_of_a_quaternion_does_not_matter(length: float) -> None:
    rotation = torch.nn.functional.normalize(quaternions(), dim=-1)
    found = frames((length * rotation).float()).double()
    assert (found - frames(rotation)).abs().max() < 1e-6


def test_what_is_no_number_stays_with_its_surfel() -> None:
    rotation = quaternions()
    rotation[4, 2] = torch.nan
    found = frames(rotation)
    assert torch.isnan(found[4]).any()
    assert torch.isfinite(found[5:]).all()
    assert frames(rotation[:0]).shape == (0, 3, 3)
