"""A refined map is the same light."""

import numpy as np
import torch

from radiogs_core.scene.light import EnvironmentMap
from radiogs_datasets.blend.studio import ROWS, refined


def test_a_refined_map_is_looked_up_as_the_map_itself() -> None:
    light = np.random.default_rng(0).random((16, 32, 3)).astype(np.float32)
    fine = refined(light)
    assert fine.shape == (16 * 31, 32 * 31, 3)
    directions = torch.nn.functional.normalize(
        torch.from_numpy(np.random.default_rng(1).normal(size=(5000, 3))), dim=-1
    )
    found, wanted = (EnvironmentMap(torch.from_numpy(each)).lookup(directions.float()) for each in (fine, light))
    assert float((found - wanted).abs().max()) < 2e-4


def test_a_fine_map_stays_as_it_is() -> None:
    light = np.random.default_rng(0).random((ROWS, 8, 3)).astype(np.float32)
    assert np.array_equal(refined(light), light)


def test_rows_end_at_the_poles_and_columns_wrap() -> None:
    light = np.zeros((16, 32, 1), np.float32)
    light[0], light[8, 0] = 1, 1
    fine = refined(light)
    assert (fine[0] == 1).all()
    assert not fine[-1].any()
    assert fine[8 * 31 + 15, -1] > 0
    assert fine[8 * 31 + 15, 47] == 0
