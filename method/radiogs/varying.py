"""A trained model with changed roughness or brightness, to measure which quantities the images determine."""

import math
from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.errors import UsageError
from radiogs_core.kernels.image.display import displayed
from radiogs_core.kernels.rasterize.rasterize import blend
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import texel_solid_angles
from radiogs_core.surfels.surfels import ROUGHNESS_FLOOR
from radiogs_core.transport.blending_weights import blending_weights
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.prefiltered_light import PrefilteredLight, split_sum_radiance
from radiogs_core.transport.shading import lambert_albedo, shade_materials
from radiogs_core.transport.splatting import DIFFUSE_DIRECT, DIFFUSE_INDIRECT, towards

from .model import Model
from .nuisance import Answer, Blending, Jacobian, NuisanceOfSurfels, light_blocks, to_light, turned
from .settings import Variant

FREE_UNLESS_GIVEN: Mapping[str, tuple[str, ...]] = {
    "roughness": ("roughness",),
    "roughness variation": ("roughness",),
    "brightness": ("light", "albedo"),
    "brightness, albedo free": ("light", "albedo"),
}
"""By quantity: the parts of the truth that fix it if given (``Variant.given``)."""

BRIGHTNESS = ("brightness", "brightness, albedo free")
"""The quantities that change the light."""

DIFFERENCE = 0.02
"""Change of roughness, and of the normal's slope, for the finite differences that approximate derivatives."""


class Changed(NamedTuple):
    """Materials and light with one quantity changed."""

    albedo: Float[Tensor, "surfels 3"]
    roughness: Float[Tensor, " surfels"]
    light: Float[Tensor, "rows columns 3"]
    """Linear RGB."""


class VaryingRadioGS:
    """A RadioGS model for a few cameras with one quantity changed; see ``radiogs_core.capabilities.VaryingFreely``.

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
        self.straight, self.masking, self.given = variant.straight, variant.masking, set(variant.given)
        like = self.surfels.centre
        self.cameras = [camera.to(like.device, like.dtype) for camera in cameras]
        with torch.no_grad():
            self.albedo, self.roughness = self.surfels.albedo.detach(), self.surfels.roughness.detach()
            self.light = model.environment.detach()
            self.outgoing = torch.stack([towards(camera, self.surfels) for camera in self.cameras], 1)
            self.projected = [self.surfels.seen_by(camera, radiance=False) for camera in self.cameras]
        seen = torch.stack([blending_weights(camera, self.surfels) for camera in self.cameras])
        total = seen.sum(1, keepdim=True)
        self.weight = seen / torch.where(total > 0, total, 1.0)
        self.share = self.weight.sum(0) / self.weight.sum().clamp(min=torch.finfo(like.dtype).tiny)
        self.mean_roughness = (self.share * self.roughness).sum()
        self.unit, self.rest = self._shaded(self.roughness, self.light)
        self.changed: dict[tuple[str, float], Changed] = {}
        self.free = [each for each, parts in FREE_UNLESS_GIVEN.items() if not set(parts) & self.given]

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
        self._require_free(quantity)
        changed, radiance = self._change(quantity, amount)
        self.changed[quantity, amount] = changed
        return self._seen(radiance)

    def nuisance(self, quantity: str) -> NuisanceOfSurfels:
        """Everything but ``quantity`` that was learnt and is not given: see docs/what_images_determine.md.

        Raises UsageError as ``images`` does.
        """
        self._require_free(quantity)
        jacobian, new = self._jacobian, self.albedo.new_ones
        seen, blocks = jacobian.seen, jacobian.to_light.shape[-1]
        every = Answer(new(len(seen), 3), new(len(seen)), new(len(seen), 2), new(blocks, 3))
        kept = none = Answer(*map(torch.zeros_like, every))
        if quantity == "roughness variation":
            # Weighted by what roughness changes in the images: those that it does not change cannot undo the change.
            effect = (self.weight[:, seen, None] * jacobian.to_roughness.square()).sum((0, 2))
            kept = none._replace(roughness=effect * (self.roughness[seen] - self.mean_roughness))
        if quantity == "brightness, albedo free":
            kept = none._replace(light=jacobian.light_pull(self.weight[:, seen, None].expand(-1, -1, 3)))
        held = {
            "albedo": "albedo" in self.given or quantity == "brightness",
            "roughness": "roughness" in self.given or quantity == "roughness",
            "slope": "geometry" in self.given,
            "light": "light" in self.given,
        }
        free = every._replace(**{name: getattr(none, name) for name, is_held in held.items() if is_held})
        return NuisanceOfSurfels(jacobian, free, kept, partial(self._answered, quantity))

    @torch.no_grad()
    def _answered(self, quantity: str, amount: float, answer: Answer) -> list[Float[Tensor, "height width 3"]]:
        """Images with a quantity changed, and everything else by an answer for the surfels that cameras see."""
        key = quantity, amount
        albedo, roughness, light = self.changed[key] if key in self.changed else self._change(*key)[0]
        seen = self._jacobian.seen
        slope = torch.zeros_like(albedo[:, :2]).index_copy_(0, seen, answer.slope)
        roughness = roughness.index_add(0, seen, answer.roughness).clamp(ROUGHNESS_FLOOR, 1)
        if len(answer.light):
            block = light_blocks(light)
            light = light * answer.light[block].view_as(light).exp()
        unit, rest = self._shaded(roughness, light, turned(self.surfels.frame.detach(), slope))
        return self._seen(albedo.index_add(0, seen, answer.albedo).clamp(0, 1) * unit + rest)

    @cached_property
    @torch.no_grad()
    def _jacobian(self) -> Jacobian:
        """The Jacobian of the images at the recovered model; for split-sum shading the light is not part of it."""
        seen = torch.nonzero(self.weight.sum(0) > 0)[:, 0]
        here = self.albedo * self.unit + self.rest
        inwards = torch.where(self.roughness > 0.5, -DIFFERENCE, DIFFERENCE)

        def slope_of(unit: Tensor, rest: Tensor) -> Float[Tensor, "cameras seen 3"]:
            return (self.albedo * unit + rest - here)[:, seen] / DIFFERENCE

        to_roughness = slope_of(*self._shaded(self.roughness + inwards, self.light)) * inwards[seen, None].sign()
        axes = DIFFERENCE * torch.eye(2).to(here)
        frame = self.surfels.frame.detach()
        to_slope = [slope_of(*self._shaded(self.roughness, self.light, turned(frame, axis))) for axis in axes]
        by_light = here.new_zeros(3, len(self.cameras), len(seen), 0)
        if self.incident is not None:
            lobes = self.model.plan.specular_among(self.albedo)
            own, some = self.surfels.take(seen), None if lobes is None else lobes[seen]
            by_light = to_light(own, self.outgoing[seen], self.incident.of(seen), self.light, some)
        blendings = [
            Blending(seen_by, radiance, self.straight) for seen_by, radiance in zip(self.projected, here, strict=True)
        ]
        return Jacobian(seen, self.unit[:, seen], to_roughness, torch.stack(to_slope, -1), by_light, blendings)

    def _require_free(self, quantity: str) -> None:
        if quantity not in self.free:
            raise UsageError(
                f"'{quantity}' cannot be changed: it is unknown, or fixed by a given part of the truth",
                remedy=f"Quantities of this model: {', '.join(self.free)}.",
            )

    def _change(self, quantity: str, amount: float) -> tuple[Changed, Float[Tensor, "cameras surfels 3"]]:
        """The model with a quantity changed and its albedo compensating it, and its radiance, linear RGB."""
        if amount == 0:
            return Changed(self.albedo, self.roughness, self.light), self.albedo * self.unit + self.rest
        roughness, light, factor = self.roughness, self.light, 1.0
        if quantity == "roughness":
            roughness = roughness + amount
        elif quantity == "roughness variation":
            roughness = self.mean_roughness + (1 - amount) * (roughness - self.mean_roughness)
        else:
            factor, light = math.exp(amount), light * math.exp(-amount)
        roughness = roughness.clamp(ROUGHNESS_FLOOR, 1)
        unit, rest = self._shaded(roughness, light)
        albedo = factor * self.albedo
        change = rest - self.rest
        if quantity == "brightness, albedo free":
            change = change + albedo * unit - self.albedo * self.unit
        # Albedo compensates the mean change of radiance, within [0, 1]; where no light arrives it stays.
        weight = self.weight[..., None]
        mean_change, irradiance = (weight * change).sum(0), (weight * unit).sum(0)
        lit = irradiance > 0
        albedo = (albedo - torch.where(lit, mean_change / torch.where(lit, irradiance, 1.0), 0.0)).clamp(0, 1)
        return Changed(albedo, roughness, light), albedo * unit + rest

    @torch.no_grad()
    def _shaded(
        self,
        roughness: Float[Tensor, " surfels"],
        light: Float[Tensor, "rows columns 3"],
        normal: Float[Tensor, "surfels 3"] | None = None,
    ) -> tuple[Float[Tensor, "cameras surfels 3"], Float[Tensor, "cameras surfels 3"]]:
        """U and R towards each camera, linear RGB: diffuse radiance for an albedo of 1, and radiance of the lobe.

        ``normal``: unit normals in the world; None: the surfels' own.
        """
        normal = self.surfels.frame[..., 2] if normal is None else normal
        white, outgoing = torch.ones_like(self.albedo), self.outgoing
        if self.incident is None:
            prefiltered = PrefilteredLight(light, self.masking)
            each = [split_sum_radiance(normal, white, roughness, view, prefiltered) for view in outgoing.unbind(1)]
            unit, rest = (torch.stack(parts) for parts in zip(*each, strict=True))
            return unit, rest
        specular_at = self.model.plan.specular_among(self.albedo)
        parts = shade_materials(normal, white, roughness, outgoing, self.incident, light, specular_at).transpose(0, 1)
        diffuse = parts[..., DIFFUSE_DIRECT, :] + parts[..., DIFFUSE_INDIRECT, :]
        unit = diffuse / lambert_albedo(white, roughness, specular_at)
        return unit, parts.sum(-2) - unit

    def _seen(self, radiance: Float[Tensor, "cameras surfels 3"]) -> list[Float[Tensor, "height width 3"]]:
        images = []
        for seen, own in zip(self.projected, radiance, strict=True):
            raster = blend(seen, own, depth_unit=1.0)
            images.append(displayed(raster.features, raster.alpha, self.straight).clamp(0, 1))
        return images
