"""The parameters that can compensate a change of roughness or brightness in RadioGS, and their Jacobian."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from radiogs_core.kernels.image.display import displayed
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import bilinear_texels
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.shading import lambert_albedo, shade_materials
from radiogs_core.transport.splatting import SPECULAR_INDIRECT, splat, towards


class Answer(NamedTuple):
    """A change of every nuisance parameter of N surfels and a light."""

    albedo: Float[Tensor, "surfels 3"]
    """Added to the linear albedo."""
    roughness: Float[Tensor, " surfels"]
    """Added to the perceptual roughness."""
    slope: Float[Tensor, "surfels 2"]
    """Added to the normal, along the first two axes of the surfel's frame; the sum is normalised."""
    light: Float[Tensor, "texels 3"]
    """Added to the natural logarithm of each texel's radiance."""

    def flat(self) -> Float[Tensor, " parameters"]:
        """All changes as one vector."""
        return torch.cat([part.flatten() for part in self])

    @classmethod
    def of(cls, flat: Float[Tensor, " parameters"], surfels: int) -> "Answer":
        """The inverse of ``flat``."""
        albedo, roughness, slope, light = flat.split([3 * surfels, surfels, 2 * surfels, len(flat) - 6 * surfels])
        return cls(albedo.view(-1, 3), roughness, slope.view(-1, 2), light.view(-1, 3))


UNITS = Answer(*map(torch.tensor, (0.1, 0.1, 0.1, 0.25)))
"""The change of each parameter within which images are about linear in it: a tenth of the range of albedo and roughness,
a slope of 0.1 of the normal (6 degrees), and a quarter of a light's radiance."""


def turned(
    frame: Float[Tensor, "surfels 3 3"], slope: Float[Tensor, "surfels 2"] | Float[Tensor, "2"]
) -> Float[Tensor, "surfels 3"]:
    """Unit normals in the world: those of the frames, tilted by ``slope`` along the first two axes."""
    return normalize(frame[..., 2] + (frame[..., :2] * slope[..., None, :]).sum(-1), dim=-1)


@dataclass(frozen=True)
class LightPaths:
    """The radiance that surfels send towards cameras as a linear function of a light's texels."""

    radiance: Float[Tensor, "texels 3"]
    """The light as recovered, linear RGB: an answer multiplies it."""
    texel: Int[Tensor, "surfels samples 4"]
    """The texels around each direction of incident light."""
    share: Float[Tensor, "surfels samples 4"]
    """Bilinear shares of these texels, times the visibility."""
    diffuse: Float[Tensor, "surfels samples"]
    """Diffuse radiance of an albedo of 1 by an incident radiance of 1 along each direction."""
    albedo: Float[Tensor, "cameras surfels 3"]
    """Lambertian albedo; zero towards cameras behind the surfel."""
    lobe: Float[Tensor, "surfels cameras samples"]
    """Radiance of the lobe by an incident radiance of 1 along each direction."""

    def change(self, light: Float[Tensor, "texels 3"]) -> Float[Tensor, "cameras surfels 3"]:
        """The linearised change of radiance by a change of the light's logarithm."""
        arriving = ((self.radiance * light)[self.texel] * self.share[..., None]).sum(-2)
        scattered = torch.einsum("sk,skc->sc", self.diffuse, arriving)
        return self.albedo * scattered + torch.bmm(self.lobe, arriving).transpose(0, 1)

    def pull(self, radiance: Float[Tensor, "cameras surfels 3"]) -> Float[Tensor, "texels 3"]:
        """The transposed product with ``change``."""
        scattered = (self.albedo * radiance).sum(0)
        arriving = self.diffuse[..., None] * scattered[:, None]
        arriving = arriving + torch.bmm(self.lobe.transpose(1, 2), radiance.transpose(0, 1))
        by_texel = (arriving[..., None, :] * self.share[..., None]).reshape(-1, 3)
        return self.radiance * torch.zeros_like(self.radiance).index_add_(0, self.texel.flatten(), by_texel)


@torch.no_grad()
def light_paths(
    surfels: Surfels,
    cameras: Sequence[Camera],
    incident: Incident,
    light: Float[Tensor, "rows columns 3"],
    specular_at: Bool[Tensor, " surfels"] | None,
) -> LightPaths:
    """The paths of distant light to surfels and on to cameras; ``incident`` is that of these surfels."""
    normal, roughness = surfels.frame[..., 2], surfels.roughness
    texel, share = bilinear_texels(incident.direction, *light.shape[:2])
    cosine = (incident.direction * normal[:, None]).sum(-1).clamp(min=0)
    outgoing = torch.stack([towards(camera, surfels) for camera in cameras], 1)
    in_front = ((outgoing * normal[:, None]).sum(-1) > 0).T[..., None]
    lobes = [_lobe(surfels, outgoing[:, place], incident, light, specular_at) for place in range(len(cameras))]
    return LightPaths(
        radiance=light.flatten(0, 1),
        texel=texel,
        share=share * incident.visibility[..., None],
        diffuse=incident.weight * cosine / torch.pi,
        albedo=in_front * lambert_albedo(surfels.albedo, roughness, specular_at),
        lobe=torch.stack(lobes, 1),
    )


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
    """The image of one camera as a linearised function of its surfels' radiance; see ``splat`` and ``displayed``."""

    def __init__(
        self, camera: Camera, surfels: Surfels, radiance: Float[Tensor, "surfels 3"], straight: bool
    ) -> None:
        """Linearise around ``radiance``, linear RGB. Clipped pixels do not change."""
        self.camera, self.surfels = camera, surfels
        with torch.enable_grad():
            self.radiance = radiance.detach().requires_grad_()
            seen = splat(camera, surfels, {"radiance": self.radiance}, depth_unit=1.0)
            self.blended = seen.images["radiance"]
            pixels = self.blended.detach().requires_grad_()
            image = displayed(pixels, seen.alpha.detach(), straight).clamp(0, 1)
            (self.slope,) = torch.autograd.grad(image.sum(), pixels)

    def change(self, radiance: Float[Tensor, "surfels 3"]) -> Float[Tensor, "height width 3"]:
        """The linearised change of the image, display sRGB, by a change of radiance."""
        return self.slope * splat(self.camera, self.surfels, {"radiance": radiance}, depth_unit=1.0).images["radiance"]

    def pull(self, image: Float[Tensor, "height width 3"]) -> Float[Tensor, "surfels 3"]:
        """The transposed product with ``change``."""
        return torch.autograd.grad(self.blended, self.radiance, self.slope * image, retain_graph=True)[0]


@dataclass(frozen=True)
class Jacobian:
    """The linearised images of a model as a function of its nuisance parameters."""

    seen: Int[Tensor, " seen"]
    """Surfels that a camera sees; all others have no parameters."""
    to_albedo: Float[Tensor, "cameras seen 3"]
    """Derivative of a surfel's radiance, linear RGB, to its albedo; those to roughness and slope follow."""
    to_roughness: Float[Tensor, "cameras seen 3"]
    to_slope: Float[Tensor, "cameras seen 3 2"]
    paths: LightPaths | None
    """The light's way to the cameras; None if the light does not answer."""
    blendings: Sequence[Blending]

    @torch.no_grad()
    def change(self, answer: Answer) -> list[Float[Tensor, "height width 3"]]:
        """The change of each image, display sRGB."""
        radiance = self.to_albedo * answer.albedo + self.to_roughness * answer.roughness[:, None]
        radiance = radiance + (self.to_slope * answer.slope[:, None]).sum(-1)
        if self.paths is not None:
            radiance = radiance + self.paths.change(answer.light)
        return [
            each.change(torch.zeros_like(each.radiance).index_copy_(0, self.seen, own))
            for each, own in zip(self.blendings, radiance, strict=True)
        ]

    def pull(self, images: Sequence[Float[Tensor, "height width 3"]]) -> Answer:
        """The transposed product with ``change``."""
        pulls = [each.pull(image)[self.seen] for each, image in zip(self.blendings, images, strict=True)]
        radiance = torch.stack(pulls)
        light = radiance.new_zeros(0, 3) if self.paths is None else self.paths.pull(radiance)
        return Answer(
            (self.to_albedo * radiance).sum(0),
            (self.to_roughness * radiance).sum((0, 2)),
            (self.to_slope * radiance[..., None]).sum((0, 2)),
            light,
        )


class NuisanceOfSurfels:
    """The nuisance parameters of one quantity of RadioGS; see ``radiogs_core.capabilities.Nuisance``.

    Args:
        jacobian: The linearised images.
        free: For each parameter, whether it may answer.
        kept: The linear function of an answer that stays zero, so that no answer undoes the quantity's change; None if
            no free parameter can.
        render: The images with the quantity changed by an amount and everything else by an answer.
    """

    def __init__(
        self,
        jacobian: Jacobian,
        free: Answer,
        kept: Answer | None,
        render: Callable[[float, Answer], list[Float[Tensor, "height width 3"]]],
    ) -> None:
        self.jacobian, self.render = jacobian, render
        self.unit = Answer(*(part * unit.to(part) for part, unit in zip(free, UNITS, strict=True))).flat()
        direction = torch.zeros_like(self.unit) if kept is None else self.unit * kept.flat()
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
