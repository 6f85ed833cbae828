"""Deferred split-sum shading of seen points: L_o = a (O E(n) + (1 - O) I) + S (F0 A + B).

O occludes the diffuse part alone. Normals and places have no gradient.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from ..seen_points import SeenPoints
from ..split_sum import SplitSumLight


@dataclass(frozen=True)
class Shaded:
    """Outgoing radiance of points towards the camera, linear: after one surface, and after more."""

    direct: Float[Tensor, "points 3"]
    indirect: Float[Tensor, "points 3"]

    @property
    def radiance(self) -> Float[Tensor, "points 3"]:
        """All of it."""
        return self.direct + self.indirect


def shade_points(
    points: SeenPoints,
    light: SplitSumLight,
    openness: Float[Tensor, " points"] | None = None,
    irradiance: Float[Tensor, " points"] | None = None,
    metallic: Float[Tensor, " points"] | None = None,
) -> Shaded:
    """The points under a light; zero where the camera looks from below the surface.

    openness: O, None: 1. irradiance: I, over pi and gray, None: 0. metallic: None: F0 = 0.04.
    """
    normal, outgoing = points.normal.detach(), points.outgoing
    reflected = light.reflected(normal, outgoing, points.albedo, points.roughness, metallic)
    if openness is None:
        return Shaded(reflected.radiance, torch.zeros_like(reflected.diffuse))
    direct = reflected.occluded(openness)
    if irradiance is None:
        return Shaded(direct, torch.zeros_like(direct))
    arriving = torch.where((normal * outgoing).sum(-1) > 0, (1 - openness) * irradiance, 0.0)
    return Shaded(direct, points.albedo * arriving[:, None])
