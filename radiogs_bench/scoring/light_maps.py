"""The recovered light and the true one, as maps small enough to store with every result."""

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.light import EnvironmentMap, texel_directions

LARGEST_HEIGHT = 64
"""Most rows that are stored: those of the finest learnt map (preset ``paper``); measured maps have up to 1024."""


def light_maps(found: EnvironmentMap, true: EnvironmentMap) -> dict[str, Float[Tensor, "height width 3"]]:
    """``render/environment`` and ``truth/environment``, linear, of the same size: latitude-longitude, Z up.

    The true map is averaged over blocks of texels, so that a small sun loses no energy; the recovered one is
    interpolated.
    """
    radiance = true.radiance.cpu()
    height = min(radiance.shape[0], LARGEST_HEIGHT)
    reduced = torch.nn.functional.adaptive_avg_pool2d(radiance.movedim(-1, 0), (height, 2 * height)).movedim(0, -1)
    directions = texel_directions(height, 2 * height, dtype=found.radiance.dtype)
    return {"render/environment": found.lookup(directions), "truth/environment": reduced}
