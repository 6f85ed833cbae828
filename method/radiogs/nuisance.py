"""The parameters that can compensate a change of roughness or brightness in RadioGS, and their Jacobian."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from radiogs_core.kernels.image.display import displayed
from radiogs_core.kernels.rasterize.projection import Projection
from radiogs_core.kernels.rasterize.rasterize import blend
from radiogs_core.scene.light import bilinear_texels
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.shading import lambert_albedo, shade_materials
from radiogs_core.transport.splatting import SPECULAR_INDIRECT


class Answer(NamedTuple):
    """A change of every nuisance parameter of N surfels and a light."""

    albedo: Float[Tensor, "surfels 3"]
    """Added to the linear albedo."""
    roughness: Float[Tensor, " surfels"]
    """Added to the perceptual roughness."""
    slope: Float[Tensor, "surfels 2"]
    """Added to the normal, along the first two axes of the surfel's frame; the sum is normalised."""
    light: Float[Tensor, "blocks 3"]
    """Added to the natural logarithm of the radiance of each block (``light_blocks``)."""

    def flat(self) -> Float[Tensor, " parameters"]:
        """All changes as one vector."""
        return torch.cat([part.flatten() for part in self])

    @classmethod
    def of(cls, flat: Float[Tensor, " parameters"], surfels: int) -> "Answer":
        """The inverse of ``flat``."""
        albedo, roughness, slope, light = flat.split([3 * surfels, surfels, 2 * surfels, len(flat) - 6 * surfels])
        return cls(albedo.view(-1, 3), roughness, slope.view(-1, 2), light.view(-1, 3))


UNITS = Answer(*map(torch.tensor, (0.1, 0.1, 0.1, 0.25)))
"""The change of each parameter within which images are about linear in it: a tenth of the range of albedo and
roughness, a slope of 0.1 of the normal (6 degrees), and a quarter of a light's radiance."""


def turned(
    frame: Float[Tensor, "surfels 3 3"], slope: Float[Tensor, "surfels 2"] | Float[Tensor, "2"]
) -> Float[Tensor, "surfels 3"]:
    """Unit normals in the world: the frames' normals, tilted by ``slope`` along the first two axes."""
    return normalize(frame[..., 2] + (frame[..., :2] * slope[..., None, :]).sum(-1), dim=-1)


LIGHT_ROWS = 8
"""Most rows of blocks in which a light may change, with twice as many columns: one factor for all texels of a block."""

TOGETHER = 256
"""Surfels whose light is assigned to blocks at once."""


def light_blocks(light: Float[Tensor, "height width 3"]) -> Int[Tensor, " texels"]:
    """The block of each texel of a light; blocks are numbered from 0 row by row."""
    height, width = light.shape[:2]
    rows, columns = min(height, LIGHT_ROWS), min(width, 2 * LIGHT_ROWS)
    row = torch.arange(height, device=light.device) * rows // height
    column = torch.arange(width, device=light.device) * columns // width
    return (row[:, None] * columns + column).flatten()


@torch.no_grad()
def to_light(
    surfels: Surfels,
    outgoing: Float[Tensor, "surfels cameras 3"],
    incident: Incident,
    light: Float[Tensor, "rows columns 3"],
    specular_at: Bool[Tensor, " surfels"] | None,
) -> Float[Tensor, "3 cameras surfels blocks"]:
    """Derivative of the radiance towards each camera to the logarithm of the light's blocks, by channel.

    ``outgoing``: unit directions from the surfels to the cameras. ``incident``: the light on these surfels.
    """
    normal = surfels.frame[..., 2]
    in_front = ((outgoing * normal[:, None]).sum(-1) > 0).to(light)
    cosine = (incident.direction * normal[:, None]).sum(-1).clamp(min=0)
    diffuse = in_front[..., None] * (incident.weight * cosine / torch.pi)[:, None]
    lobes = [_lobe(surfels, view, incident, light, specular_at) for view in outgoing.unbind(1)]
    lobe, albedo = torch.stack(lobes, 1), lambert_albedo(surfels.albedo, surfels.roughness, specular_at)
    texel, share = bilinear_texels(incident.direction, *light.shape[:2])
    share = share * incident.visibility[..., None]
    block = light_blocks(light)
    blocks, radiance = int(block.max()) + 1, light.flatten(0, 1)
    found = []
    for some in torch.arange(len(normal), device=light.device).split(TOGETHER):
        own, index = texel[some], block[texel[some]]
        for channel in range(3):
            arriving = share.new_zeros(*own.shape[:2], blocks)
            arriving.scatter_add_(2, index, share[some] * radiance[own, channel])
            found.append(torch.bmm(albedo[some, channel, None, None] * diffuse[some] + lobe[some], arriving))
    return torch.stack([torch.cat(found[channel::3]).transpose(0, 1) for channel in range(3)]).contiguous()


def _lobe(
    surfels: Surfels,
    outgoing: Float[Tensor, "surfels 3"],
    incident: Incident,
    light: Float[Tensor, "rows columns 3"],
    specular_at: Bool[Tensor, " surfels"] | None,
) -> Float[Tensor, "surfels samples"]:
    """The lobe's radiance by an incident radiance of 1 along each direction, by differentiation of the shading."""
    with torch.enable_grad():
        arriving = incident.radiance.detach().requires_grad_()
        parts = shade_materials(
            surfels.frame[..., 2].detach(), surfels.albedo.detach(), surfels.roughness.detach(),
            outgoing[:, None], replace(incident, radiance=arriving), light, specular_at,
        )  # fmt: skip
        return torch.autograd.grad(parts[:, 0, SPECULAR_INDIRECT, 0].sum(), arriving)[0][..., 0]


class Blending:
    """The image of one camera as a linearised function of its surfels' radiance; see ``blend`` and ``displayed``."""

    def __init__(self, seen: Projection, radiance: Float[Tensor, "surfels 3"], straight: bool) -> None:
        """Linearise around ``radiance``, linear RGB, of the projected surfels. Clipped pixels do not change."""
        self.seen = seen
        with torch.enable_grad():
            self.radiance = radiance.detach().requires_grad_()
            raster = blend(seen, self.radiance, depth_unit=1.0)
            self.blended = raster.features
            pixels = self.blended.detach().requires_grad_()
            image = displayed(pixels, raster.alpha.detach(), straight).clamp(0, 1)
            (self.slope,) = torch.autograd.grad(image.sum(), pixels)

    def change(self, radiance: Float[Tensor, "surfels 3"]) -> Float[Tensor, "height width 3"]:
        """The linearised change of the image, display sRGB, by a change of radiance."""
        return self.slope * blend(self.seen, radiance, depth_unit=1.0).features

    def pull(self, image: Float[Tensor, "height width 3"]) -> Float[Tensor, "surfels 3"]:
        """The transposed product with ``change``."""
        return torch.autograd.grad(self.blended, self.radiance, self.slope * image, retain_graph=True)[0]


@dataclass(frozen=True)
class Jacobian:
    """The linearised images of a model as a function of its nuisance parameters."""

    seen: Int[Tensor, " seen"]
    """Surfels that a camera sees; all others have no parameters."""
    to_albedo: Float[Tensor, "cameras seen 3"]
    """Derivative of a surfel's radiance, linear RGB, to its albedo; derivatives to roughness and slope follow."""
    to_roughness: Float[Tensor, "cameras seen 3"]
    to_slope: Float[Tensor, "cameras seen 3 2"]
    to_light: Float[Tensor, "3 cameras seen blocks"]
    """Derivative to the logarithm of the light's blocks, by channel; no block if the light is fixed."""
    blendings: Sequence[Blending]

    @torch.no_grad()
    def change(self, answer: Answer) -> list[Float[Tensor, "height width 3"]]:
        """The change of each image, display sRGB."""
        radiance = self.to_albedo * answer.albedo + self.to_roughness * answer.roughness[:, None]
        radiance = radiance + (self.to_slope * answer.slope[:, None]).sum(-1)
        # A product with a vector for each channel takes a third of the time of a batched product with matrices.
        channels = zip(self.to_light.flatten(1, 2), answer.light.T.contiguous(), strict=True)
        by_light = torch.stack([each @ light for each, light in channels], -1)
        radiance = radiance + by_light.view_as(radiance)
        return [
            each.change(torch.zeros_like(each.radiance).index_copy_(0, self.seen, own))
            for each, own in zip(self.blendings, radiance, strict=True)
        ]

    def pull(self, images: Sequence[Float[Tensor, "height width 3"]]) -> Answer:
        """The transposed product with ``change``."""
        pulls = [each.pull(image)[self.seen] for each, image in zip(self.blendings, images, strict=True)]
        radiance = torch.stack(pulls)
        return Answer(
            (self.to_albedo * radiance).sum(0),
            (self.to_roughness * radiance).sum((0, 2)),
            (self.to_slope * radiance[..., None]).sum((0, 2)),
            self.light_pull(radiance),
        )

    def light_pull(self, radiance: Float[Tensor, "cameras seen 3"]) -> Float[Tensor, "blocks 3"]:
        """The derivative to the light of the sum of ``radiance`` times the radiance towards the cameras."""
        return torch.bmm(radiance.permute(2, 0, 1).reshape(3, 1, -1), self.to_light.flatten(1, 2))[:, 0].T

    def scale(self, unit: Float[Tensor, " parameters"]) -> Float[Tensor, " parameters"]:
        """The root of |J|' |J| 1 for parameters in ``unit``; 1 where a parameter changes no image."""
        size = replace(self, to_roughness=self.to_roughness.abs(), to_slope=self.to_slope.abs())
        changes = size.change(Answer.of(unit, len(self.seen)))
        square = unit * size.pull(changes).flat()
        return torch.where(square > 0, square, 1.0).sqrt()


class NuisanceOfSurfels:
    """The nuisance parameters of one quantity of RadioGS; see ``radiogs_core.capabilities.Nuisance``.

    Args:
        jacobian: The linearised images.
        free: For each parameter, whether it may answer.
        kept: The linear function of an answer that stays zero, so that no answer undoes the quantity's change; zeros if
            no free parameter can.
        render: The images with the quantity changed by an amount and everything else by an answer.
    """

    def __init__(
        self,
        jacobian: Jacobian,
        free: Answer,
        kept: Answer,
        render: Callable[[float, Answer], list[Float[Tensor, "height width 3"]]],
    ) -> None:
        self.jacobian, self.render = jacobian, render
        self.unit = Answer(*(part * unit.to(part) for part, unit in zip(free, UNITS, strict=True))).flat()
        direction = self.unit * kept.flat()
        self.scale = 1 / jacobian.scale(self.unit)
        self.kept = direction / direction.norm().clamp(min=torch.finfo(direction.dtype).tiny)

    @property
    def like(self) -> Float[Tensor, " parameters"]:
        """An answer that changes nothing."""
        return torch.zeros_like(self.unit)

    def change(self, answer: Float[Tensor, " parameters"]) -> list[Float[Tensor, "height width 3"]]:
        """The linearised change of each image, display sRGB."""
        return self.jacobian.change(self._scaled(answer))

    def pull(self, images: Sequence[Float[Tensor, "height width 3"]]) -> Float[Tensor, " parameters"]:
        """The transposed product with ``change``."""
        return self._without_kept(self.unit * self.jacobian.pull(images).flat())

    def images(self, amount: float, answer: Float[Tensor, " parameters"]) -> list[Float[Tensor, "height width 3"]]:
        """The images, rendered, not linearised."""
        return self.render(amount, self._scaled(answer))

    def _scaled(self, answer: Float[Tensor, " parameters"]) -> Answer:
        return Answer.of(self.unit * self._without_kept(answer), len(self.jacobian.seen))

    def _without_kept(self, vector: Float[Tensor, " parameters"]) -> Float[Tensor, " parameters"]:
        return vector - self.kept * (self.kept @ vector)
