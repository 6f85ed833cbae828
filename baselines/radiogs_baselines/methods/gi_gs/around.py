"""What the marches of a frame come to: occlusion, and the light of other pixels."""

import torch
from jaxtyping import Float, Int
from torch import Tensor

from .grid import GATHERED, Grid
from .marching import LOOKUPS_AT_ONCE, NOTHING


def openness(met: Int[Tensor, "points directions"], grid: Grid) -> Float[Tensor, " points"]:
    """O: the cosine-weighted share of each point's directions that meets nothing, in [0, 1]."""
    share = grid.share
    return torch.cat([(some == NOTHING).to(share) @ share for some in _parts(met)]).clamp(0, 1)


def gathered(
    met: Int[Tensor, "points directions"], radiance: Float[Tensor, "height width 3"], grid: Grid
) -> Float[Tensor, "points 3"]:
    """Irradiance over pi from the pixels that are met, by their linear radiance; see ``grid.GATHERED``."""
    return GATHERED * _weighted(met, radiance, grid.share)


def mean_radiance(
    met: Int[Tensor, "points directions"], radiance: Float[Tensor, "height width 3"], grid: Grid
) -> Float[Tensor, "points 3"]:
    """The same without a cosine: mean radiance over the hemisphere."""
    return _weighted(met, radiance, grid.spread)


def _weighted(met: Tensor, radiance: Tensor, weight: Tensor) -> Tensor:
    # Pixel -1 is a black one.
    padded = torch.cat([radiance.flatten(0, 1), radiance.new_zeros(1, 3)])
    return torch.cat([(padded[some.long()] * weight[:, None]).sum(1) for some in _parts(met)])


def _parts(met: Tensor) -> tuple[Tensor, ...]:
    return met.split(max(1, LOOKUPS_AT_ONCE // met.shape[1]))
