"""The light that a model found and the true one, as pictures that are small enough to keep with every result."""

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.light import EnvironmentMap, texel_directions

LARGEST_HEIGHT = 64
"""Rows that are kept: as many as the finest learnt map has (preset ``paper``); measured maps have up to 1024."""


def light_maps(found: EnvironmentMap, true: EnvironmentMap) -> dict[str, Float[Tensor, "height width 3"]]:
    """``render/environment`` and ``truth/environment``, linear, at one size: latitude-longitude, Z up.

    The true map is averaged over blocks of texels, so that a small sun loses no energy; the found one is looked up.
    """
    radiance = true.radiance.cpu()
    height = min(radiance.shape[0], LARGEST_HEIGHT)
    reduced = torch.nn.functional.adaptive_avg_pool2d(radiance.movedim(-1, 0), (height, 2 * height)).movedim(0, -1)
    directions = texel_directions(height, 2 * height, dtype=found.radiance.dtype)
    return {"render/environment": found.lookup(directions), "truth/environment": reduced}
