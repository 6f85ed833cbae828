"""A light as the split sum reads it: filtered by roughness, and looked up in one of two frames."""

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.light import EnvironmentMap, bilinear_texels
from radiogs_core.transport.splitsum import GRID_HEIGHT, GRID_SIZE, LEVELS, PrefilteredLight

from .variant import Frame

Y_UP = ((0.0, 0.0, -1.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
"""Where a lookup with Y up, u = 1/2 + atan2(x, -z) / 2 pi and v = acos(y) / pi, finds a direction on a map whose frame
has Z up (``scene.light``)."""


class SplitSumLight:
    """Radiance of a light map, averaged over cosine and GGX lobes; differentiable in its texels.

    ``radiance``: linear, lat-long (see ``scene.light``).
    """

    def __init__(self, radiance: Float[Tensor, "height width 3"], frame: Frame = "oriented") -> None:
        self.filtered = PrefilteredLight(radiance)
        self.turn = radiance.new_tensor(Y_UP) if frame == "as_shipped" else None

    def irradiance(self, normal: Float[Tensor, "points 3"]) -> Float[Tensor, "points 3"]:
        """Unoccluded irradiance over pi, by unit normals in the world."""
        return self.filtered.irradiance(self._on_map(normal))

    def glossy(
        self, mirrored: Float[Tensor, "points 3"], roughness: Float[Tensor, " points"]
    ) -> Float[Tensor, "points 3"]:
        """The light averaged over lobes about unit directions: linear between the filtered maps, and below the first
        of them towards the light itself."""
        along = self._on_map(mirrored)
        place = (roughness / LEVELS[0]).clamp(0, len(LEVELS))
        lower = place.detach().floor().clamp(max=len(LEVELS) - 1).long()
        texel, share = bilinear_texels(along, GRID_HEIGHT, 2 * GRID_HEIGHT)
        maps = self.filtered.glossy.flatten(0, 2)

        def level(index: Tensor) -> Tensor:
            return (maps[index[:, None] * GRID_SIZE + texel] * share[..., None]).sum(1)

        sharp = EnvironmentMap(self.filtered.sharp).lookup(along)
        under = torch.where((lower == 0)[:, None], sharp, level((lower - 1).clamp(min=0)))
        return torch.lerp(under, level(lower), (place - lower)[:, None])

    def _on_map(self, direction: Float[Tensor, "points 3"]) -> Float[Tensor, "points 3"]:
        return direction if self.turn is None else direction @ self.turn.T
