"""A whole frame, shaded under a light, with occlusion and one bounce that are found in the frame itself."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ..split_sum import SplitSumLight
from .around import gathered, mean_radiance, openness
from .composition import median, summed
from .gbuffer import GBuffer
from .marching import NOTHING, March
from .reflection import bounce, reflect
from .variant import Sum


@dataclass(frozen=True)
class Shader:
    """How frames are shaded. occlusion, indirect: whether the frame hides light, and whether it sends a bounce.

    sum, straight: see ``composition.summed``.
    """

    march: March
    occlusion: bool
    indirect: bool
    sum: Sum
    straight: bool

    def shade(
        self, buffer: GBuffer, alpha: Float[Tensor, "height width"], light: SplitSumLight
    ) -> dict[str, Float[Tensor, "height width 3"]]:
        """Maps of the frame on black, by name.

        ``direct``, ``indirect``: linear outgoing radiance; the second one is the median of each pixel and its
        neighbours. ``incident``: mean over the hemisphere of the radiance that arrives from other pixels. ``image``:
        the sum in display sRGB, not clipped. What other pixels send is their direct image as it is displayed, at most
        1; it has no gradient, nor has the occlusion.
        """
        grid = self.march.grid.like(buffer.place)
        met = self._met(buffer)
        reflected = reflect(buffer, light)
        open_share = openness(met, grid) if self.occlusion else torch.ones_like(buffer.roughness)
        direct = buffer.image(reflected.occluded(open_share))
        sent = direct.detach().clamp(0, 1) if self.indirect else torch.zeros_like(direct)
        indirect = median(buffer.image(bounce(buffer, gathered(met, sent, grid))))
        incident = buffer.image(mean_radiance(met, sent, grid))
        coverage = alpha[..., None]
        maps = {"direct": direct, "indirect": indirect, "incident": incident}
        maps = {name: values * coverage for name, values in maps.items()}
        return maps | {"image": summed(maps["direct"], maps["indirect"], alpha, self.sum, self.straight)}

    def _met(self, buffer: GBuffer) -> Int[Tensor, "points directions"]:
        if self.occlusion or self.indirect:
            return self.march.met(buffer)
        shape = len(buffer), len(self.march.grid.direction)
        return torch.full(shape, NOTHING, dtype=torch.int32, device=buffer.place.device)
