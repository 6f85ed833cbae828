"""A whole frame, shaded under a light: the split sum, with occlusion and one bounce that are found in the frame itself.

The marches of ``marching`` say which pixels each direction meets. From them come the open share of the hemisphere and
the light of other pixels; the display image adds direct and gathered light up.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import pad

from radiogs_core.kernels.image.display import displayed
from radiogs_core.on_surfels.split_sum import Reflected, SplitSumLight, normal_reflectance

from .gbuffer import GBuffer
from .grid import GATHERED, Grid
from .marching import LOOKUPS_AT_ONCE, NOTHING, March
from .settings import Sum


@dataclass(frozen=True)
class Shader:
    """How frames are shaded. occlusion, indirect: whether the frame hides light, and whether it sends a bounce.

    sum, straight: see ``summed``.
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


def median(image: Float[Tensor, "height width channels"]) -> Float[Tensor, "height width channels"]:
    """The median of each pixel and its eight neighbours, channel by channel; beyond the border is black."""
    padded = pad(image, (0, 0, 1, 1, 1, 1))
    height, width = image.shape[:2]
    around = [padded[row : row + height, column : column + width] for row in range(3) for column in range(3)]
    return torch.stack(around).median(0).values


def summed(
    direct: Float[Tensor, "height width 3"],
    indirect: Float[Tensor, "height width 3"],
    alpha: Float[Tensor, "height width"],
    where: Sum,
    straight: bool,
) -> Float[Tensor, "height width 3"]:
    """The display-sRGB image on black of two linear radiances, both multiplied by coverage; not clipped.

    ``where`` "display", as published: sRGB(direct) + sRGB(indirect), which is more than sRGB(direct + indirect).
    ``straight``: see ``splatting.displayed``.
    """
    if where == "linear":
        return displayed(direct + indirect, alpha, straight)
    return displayed(direct, alpha, straight) + displayed(indirect, alpha, straight)


def reflect(buffer: GBuffer, light: SplitSumLight) -> Reflected:
    """The split sum, unoccluded. Gradient to the materials and to the light."""
    return light.reflected(buffer.normal, buffer.outgoing, buffer.albedo, buffer.roughness, buffer.metallic)


def bounce(buffer: GBuffer, gathered: Float[Tensor, "points 3"]) -> Float[Tensor, "points 3"]:
    """Linear diffuse radiance by gathered irradiance over pi: k_D albedo times that; gradient to the albedo alone.

    k_D = (1 - F(n.v)) (1 - metallic), by Schlick's F.
    """
    cosine = (buffer.normal * buffer.outgoing).sum(-1)
    head_on = normal_reflectance(buffer.albedo, buffer.metallic)
    fresnel = head_on + (1 - head_on) * (1 - cosine.clamp(0, 1))[:, None] ** 5
    remaining = (1 - fresnel) * (1 - buffer.metallic)[:, None]
    sent = (remaining * gathered).detach() * buffer.albedo
    return torch.where((cosine > 0)[:, None], sent, 0.0)
