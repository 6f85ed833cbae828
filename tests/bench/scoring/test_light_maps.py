"""Stored lights have one orientation, one size, and the energy of the truth."""

import pytest
import torch

from radiogs_bench.scoring.report_arrays import LARGEST_HEIGHT, light_maps
from radiogs_core.scene.light import EnvironmentMap


def ramp(height: int) -> torch.Tensor:
    """Radiance that says where it comes from: row, column, one."""
    rows = (torch.arange(height) + 0.5) / height
    columns = (torch.arange(2 * height) + 0.5) / (2 * height)
    return torch.stack([*torch.meshgrid(rows, columns, indexing="ij"), torch.ones(height, 2 * height)], -1)


def test_both_maps_have_the_size_and_the_orientation_of_the_truth() -> None:
    kept = light_maps(EnvironmentMap(ramp(16)), EnvironmentMap(ramp(16)))
    assert kept["truth/environment"].shape == (16, 32, 3)
    assert torch.equal(kept["truth/environment"], ramp(16))
    assert torch.allclose(kept["render/environment"], ramp(16), atol=1e-5)


def test_a_large_truth_is_averaged_and_keeps_a_sun_of_one_texel() -> None:
    true = torch.zeros(4 * LARGEST_HEIGHT, 8 * LARGEST_HEIGHT, 3)
    true[101, 333] = 1600.0
    kept = light_maps(EnvironmentMap(torch.ones(4, 8, 3)), EnvironmentMap(true))
    reduced = kept["truth/environment"]
    assert reduced.shape == (LARGEST_HEIGHT, 2 * LARGEST_HEIGHT, 3)
    assert reduced[25, 83].tolist() == pytest.approx([100.0] * 3)
    assert reduced.sum() == pytest.approx(300.0)
    assert torch.allclose(kept["render/environment"], torch.ones(()))
