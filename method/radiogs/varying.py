"""A trained model with changed roughness or brightness, to measure which quantities the images determine."""

import math
from collections.abc import Mapping, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.errors import UsageError
from radiogs_core.kernels.image.display import displayed
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import texel_solid_angles
from radiogs_core.surfels.surfels import ROUGHNESS_FLOOR
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.shading import lambert_albedo, shade_materials
from radiogs_core.transport.splatting import DIFFUSE_DIRECT, DIFFUSE_INDIRECT, splat, towards
from radiogs_core.transport.splitsum import PrefilteredLight, split_sum_radiance

from .effects.image_share import image_share
from .model import Model
from .settings import Variant

FREE_UNLESS_GIVEN: Mapping[str, tuple[str, ...]] = {
    "roughness": ("roughness",),
    "roughness variation": ("roughness",),
    "brightness": ("light", "albedo"),
    "brightness, albedo free": ("light", "albedo"),
}
"""By quantity: the parts of the truth that fix it if one of them is given (``Variant.given``)."""

BRIGHTNESS = ("brightness", "brightness, albedo free")
"""The quantities that change the light."""


class VaryingRadioGS:
    """A RadioGS model for a few cameras with one quantity changed; see ``radiogs_core.capabilities.Varying``.

    Outgoing radiance is a U + R: a is the albedo, U the diffuse radiance for an albedo of 1, and R the radiance of the
    specular lobe. When roughness or light changes, the albedo of each surfel compensates the mean change of R over the
    cameras, weighted by the surfel's share of each image, within [0, 1]. Indirect light is the other surfels' own
    radiance, which was fitted to the images and does not change. So ``brightness`` shows in indirect light, which grows
    with albedo while direct light does not change, and in highlights, whose strength is F0 times the light. If the
    albedo of every surfel is free, indirect light gives no information: under any light there is an albedo with the
    same outgoing radiance, unless it exceeds 1.
    """

    def __init__(self, model: Model, incident: Incident | None, cameras: Sequence[Camera], variant: Variant) -> None:
        """``incident``: the light on each surfel in ``showing.Renderer``; None for split-sum shading."""
        self.model, self.incident, self.surfels = model, incident, model.surfels
        self.straight, self.masking = variant.straight, variant.masking
        like = self.surfels.centre
        self.cameras = [camera.to(like.device, like.dtype) for camera in cameras]
        with torch.no_grad():
            self.albedo, self.roughness = self.surfels.albedo.detach(), self.surfels.roughness.detach()
            self.light = model.environment.detach()
        self.weight = torch.stack([image_share([camera], self.surfels) for camera in self.cameras])
        self.share = self.weight.sum(0) / self.weight.sum().clamp(min=torch.finfo(like.dtype).tiny)
        self.mean_roughness = (self.share * self.roughness).sum()
        self.unit, self.rest = self._shaded(self.roughness, self.light)
        self.free = [each for each, parts in FREE_UNLESS_GIVEN.items() if not set(parts) & set(variant.given)]

    @property
    def values(self) -> Mapping[str, float]:
        """Mean and standard deviation of roughness over the images, and the light's mean linear radiance."""
        weight = texel_solid_angles(*self.light.shape[:2], dtype=torch.float64)[..., None].expand(self.light.shape)
        deviation = (self.share * (self.roughness - self.mean_roughness).square()).sum().sqrt()
        values = {
            "roughness": float(self.mean_roughness),
            "roughness variation": float(deviation),
            **dict.fromkeys(BRIGHTNESS, float((weight * self.light.cpu().double()).sum() / weight.sum())),
        }
        return {name: values[name] for name in self.free}

    @torch.no_grad()
    def images(self, quantity: str, amount: float) -> list[Float[Tensor, "height width 3"]]:
        """An image for each camera, display sRGB on black, clipped to [0, 1].

        Raises UsageError for a quantity that is given or unknown.
        """
        if quantity not in self.free:
            raise UsageError(
                f"'{quantity}' cannot be changed: it is unknown, or fixed by a given part of the truth",
                remedy=f"Quantities of this model: {', '.join(self.free)}.",
            )
        roughness, light, factor = self.roughness, self.light, 1.0
        if quantity == "roughness":
            roughness = roughness + amount
        elif quantity == "roughness variation":
            roughness = self.mean_roughness + (1 - amount) * (roughness - self.mean_roughness)
        else:
            factor, light = math.exp(amount), light * math.exp(-amount)
        unit, rest = self._shaded(roughness.clamp(ROUGHNESS_FLOOR, 1), light)
        albedo = factor * self.albedo
        change = rest - self.rest
        if quantity == "brightness, albedo free":
            change = change + albedo * unit - self.albedo * self.unit
        albedo = self._absorbing(albedo, unit, change)
        return [
            self._seen(camera, albedo * diffuse + other)
            for camera, diffuse, other in zip(self.cameras, unit, rest, strict=True)
        ]

    def _shaded(
        self, roughness: Float[Tensor, " surfels"], light: Float[Tensor, "rows columns 3"]
    ) -> tuple[Float[Tensor, "cameras surfels 3"], Float[Tensor, "cameras surfels 3"]]:
        """U and R towards each camera, linear RGB: diffuse radiance for an albedo of 1, and that of the lobe."""
        unit, rest = zip(*(self._shaded_for(camera, roughness, light) for camera in self.cameras), strict=True)
        return torch.stack(unit), torch.stack(rest)

    @torch.no_grad()
    def _shaded_for(
        self, camera: Camera, roughness: Float[Tensor, " surfels"], light: Float[Tensor, "rows columns 3"]
    ) -> tuple[Float[Tensor, "surfels 3"], Float[Tensor, "surfels 3"]]:
        normal, outgoing = self.surfels.frame[..., 2], towards(camera, self.surfels)
        white, incident = torch.ones_like(self.albedo), self.incident
        if incident is None:
            return split_sum_radiance(normal, white, roughness, outgoing, PrefilteredLight(light, self.masking))
        specular_at = self.model.plan.specular_among(self.albedo)
        parts = shade_materials(normal, white, roughness, outgoing[:, None], incident, light, specular_at)[:, 0]
        diffuse = parts[:, DIFFUSE_DIRECT] + parts[:, DIFFUSE_INDIRECT]
        unit = diffuse / lambert_albedo(white, roughness, specular_at)
        return unit, parts.sum(1) - unit

    def _absorbing(
        self,
        albedo: Float[Tensor, "surfels 3"],
        unit: Float[Tensor, "cameras surfels 3"],
        change: Float[Tensor, "cameras surfels 3"],
    ) -> Float[Tensor, "surfels 3"]:
        """The albedo that compensates the mean ``change`` of radiance, in [0, 1]; unchanged where no light arrives."""
        weight = self.weight[..., None]
        mean_change, irradiance = (weight * change).sum(0), (weight * unit).sum(0)
        lit = irradiance > 0
        return (albedo - torch.where(lit, mean_change / torch.where(lit, irradiance, 1.0), 0.0)).clamp(0, 1)

    def _seen(self, camera: Camera, radiance: Float[Tensor, "surfels 3"]) -> Float[Tensor, "height width 3"]:
        seen = splat(camera, self.surfels, {"radiance": radiance}, depth_unit=1.0)
        return displayed(seen.images["radiance"], seen.alpha, self.straight).clamp(0, 1)
