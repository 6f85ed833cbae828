"""Shading of a whole frame: the split sum, with occlusion and one bounce found in the frame itself.

``marching`` finds the pixel that each direction hits. The hits give the open share of the hemisphere and the light that
arrives from other pixels; the image is the sum of direct and gathered light.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import pad

from radiogs_core.kernels.image.display import displayed
from radiogs_core.on_surfels.split_sum_light import SplitSumLight, normal_reflectance

from .gbuffer import GBuffer
from .marching import GATHERED, LOOKUPS_AT_ONCE, NO_HIT, Grid, March
from .settings import Sum


@dataclass(frozen=True)
class Shader:
    """Shades frames with screen-space occlusion and one screen-space bounce."""

    march: March
    """Directions and lengths of the marches."""
    occlusion: bool
    """Whether surfaces in the frame occlude the light."""
    indirect: bool
    """Whether surfaces in the frame send a bounce."""
    sum: Sum
    """Colour space in which direct and indirect light are added (see ``summed``)."""
    straight: bool
    """Whether display encoding precedes the multiplication by coverage (see ``display.displayed``)."""

    def shade(
        self, buffer: GBuffer, alpha: Float[Tensor, "height width"], light: SplitSumLight
    ) -> dict[str, Float[Tensor, "height width 3"]]:
        """Maps of the frame on black, by name.

        ``direct``, ``indirect``: linear outgoing radiance; ``indirect`` is median-filtered over each pixel and its
        neighbours. ``incident``: mean over the hemisphere of the radiance that arrives from other pixels, linear.
        ``image``: the sum in display sRGB, not clipped. Other pixels send their direct radiance, clipped to [0, 1].
        Neither that radiance nor the occlusion has a gradient.
        """
        grid = self.march.grid.like(buffer.position)
        if self.occlusion or self.indirect:
            hits = self.march.hit_pixels(buffer)
        else:
            hits = torch.full((len(buffer), len(grid.direction)), NO_HIT, dtype=torch.int32, device=alpha.device)
        reflected = light.reflected(buffer.normal, buffer.outgoing, buffer.albedo, buffer.roughness, buffer.metallic)
        open_share = openness(hits, grid) if self.occlusion else torch.ones_like(buffer.roughness)
        direct = buffer.image(reflected.occluded(open_share))
        sent = direct.detach().clamp(0, 1) if self.indirect else torch.zeros_like(direct)
        gathered = GATHERED * weighted(hits, sent, grid.cosine_weight)
        indirect = median(buffer.image(bounce(buffer, gathered)))
        incident = buffer.image(weighted(hits, sent, grid.uniform_weight))
        coverage = alpha[..., None]
        maps = {"direct": direct, "indirect": indirect, "incident": incident}
        maps = {name: values * coverage for name, values in maps.items()}
        return maps | {"image": summed(maps["direct"], maps["indirect"], alpha, self.sum, self.straight)}


def openness(hits: Int[Tensor, "points directions"], grid: Grid) -> Float[Tensor, " points"]:
    """O: the cosine-weighted share of each point's directions that hit no surface, in [0, 1]."""
    weight = grid.cosine_weight
    return torch.cat([(some == NO_HIT).to(weight) @ weight for some in _parts(hits)]).clamp(0, 1)


def weighted(
    hits: Int[Tensor, "points directions"],
    radiance: Float[Tensor, "height width 3"],
    weight: Float[Tensor, " directions"],
) -> Float[Tensor, "points 3"]:
    """Linear ``radiance`` that arrives from the hit pixels, summed with the weights of the directions."""
    # Index -1 (NO_HIT) reads the appended black pixel.
    padded = torch.cat([radiance.flatten(0, 1), radiance.new_zeros(1, 3)])
    return torch.cat([(padded[some.long()] * weight[:, None]).sum(1) for some in _parts(hits)])


def _parts(hits: Tensor) -> tuple[Tensor, ...]:
    return hits.split(max(1, LOOKUPS_AT_ONCE // hits.shape[1]))


def median(image: Float[Tensor, "height width channels"]) -> Float[Tensor, "height width channels"]:
    """Median of each pixel and its eight neighbours, channel by channel; pixels beyond the border count as black."""
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
    """Display-sRGB image on black of two linear radiance maps, both multiplied by coverage; not clipped.

    ``where`` "display", as published: sRGB(direct) + sRGB(indirect), which is brighter than sRGB(direct + indirect).
    ``straight``: see ``display.displayed``.
    """
    if where == "linear":
        return displayed(direct + indirect, alpha, straight)
    return displayed(direct, alpha, straight) + displayed(indirect, alpha, straight)


def bounce(buffer: GBuffer, gathered: Float[Tensor, "points 3"]) -> Float[Tensor, "points 3"]:
    """Linear diffuse radiance of one bounce: k_D albedo ``gathered``, where ``gathered`` is irradiance over pi.

    k_D = (1 - F(n.v)) (1 - metallic), with Schlick's F. Only the albedo has a gradient.
    """
    cosine = (buffer.normal * buffer.outgoing).sum(-1)
    head_on = normal_reflectance(buffer.albedo, buffer.metallic)
    fresnel = head_on + (1 - head_on) * (1 - cosine.clamp(0, 1))[:, None] ** 5
    remaining = (1 - fresnel) * (1 - buffer.metallic)[:, None]
    sent = (remaining * gathered).detach() * buffer.albedo
    return torch.where((cosine > 0)[:, None], sent, 0.0)
