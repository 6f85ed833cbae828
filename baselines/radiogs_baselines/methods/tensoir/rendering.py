"""A trained model as it is shown: every pixel marched, and shaded where the ray is solid."""

from typing import Protocol

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.camera import Camera
from radiogs_core.scene.colour import srgb_encode

from .drawing import camera_rays
from .field import Field
from .lighting import Shaded
from .losses import on_background
from .marching import Marched, Rays, march
from .seen import seen_along
from .shading import Materials, SurfacePoints, surface_points, unit
from .variant import Variant

RAYS_AT_ONCE = 2048

Maps = dict[str, Float[Tensor, "pixels _"]]


class Light(Protocol):
    """What the points of an image are lit by."""

    def on(self, field: Field, points: SurfacePoints, generator: torch.Generator) -> Shaded:
        """What they send out."""


class Renderer:
    """A field under a light, ready to be seen from any camera.

    ``albedo_scale``: factor of the recovered albedo. ``shaded``: whether the image is of shaded points or of the
    field's own radiance. The same camera is always shown the same, whatever was rendered before: what is random is
    drawn by ``seed``.
    """

    def __init__(
        self, field: Field, variant: Variant, light: Light, seed: int, shaded: bool, albedo_scale: Float[Tensor, "3"]
    ) -> None:
        self.field, self.variant, self.light, self.seed = field, variant, light, seed
        self.shaded, self.albedo_scale = shaded, albedo_scale

    @torch.no_grad()
    def render(self, camera: Camera) -> dict[str, Float[Tensor, "height width _"]]:
        """Maps of one view, [height, width, channels], all composited on black.

        image: display sRGB, clipped to [0, 1]. direct, indirect: linear outgoing radiance of solid pixels, zero
        elsewhere. albedo: linear. roughness, alpha, depth (world z-depth): one channel. normal: unit in the world,
        zero where empty.
        """
        camera = camera.to(self.field.box.centre.device, self.field.box.centre.dtype)
        rays = camera_rays(camera, self.field.box)
        generator = torch.Generator(rays.origin.device).manual_seed(self.seed)
        along = camera.ray_directions().flatten(0, 1).norm(dim=-1, keepdim=True)
        parts = []
        for some in torch.arange(len(rays), device=rays.origin.device).split(RAYS_AT_ONCE):
            maps = self._maps(Rays(rays.origin[some], rays.direction[some]), generator)
            parts.append(maps | {"depth": maps["depth"] * self.field.box.radius / along[some]})
        shape = (camera.height, camera.width, -1)
        return {name: torch.cat([part[name] for part in parts]).view(shape) for name in parts[0]}

    def _maps(self, rays: Rays, generator: torch.Generator) -> Maps:
        marched = march(self.field, rays)
        seen = seen_along(self.field, rays, marched)
        blended = seen.materials(self.variant.normals)
        materials = Materials(blended.albedo * self.albedo_scale, blended.roughness, blended.normal)
        points = surface_points(rays, marched, materials)
        shaded = self.light.on(self.field, points, generator)
        empty = torch.zeros_like(rays.origin)
        if self.shaded:
            colour = srgb_encode((shaded.direct + shaded.indirect).clamp(0, 1))
            image = empty.index_copy(0, points.ray, colour)
        else:
            image = on_black(marched.blended(seen.radiance), marched)
        return {
            "image": image,
            "alpha": marched.alpha[:, None],
            "direct": empty.index_copy(0, points.ray, shaded.direct),
            "indirect": empty.index_copy(0, points.ray, shaded.indirect),
            "albedo": materials.albedo,
            "roughness": materials.roughness[:, None],
            "normal": unit(materials.normal),
            "depth": marched.distance[:, None],
        }


def on_black(blended: Float[Tensor, "rays 3"], marched: Marched) -> Float[Tensor, "rays 3"]:
    """The image on white, less the white that is seen: edges as images with alpha have them; display sRGB in [0, 1]."""
    alpha = marched.alpha
    on_white = on_background(blended, alpha, torch.ones_like(alpha[:, None]), linear=True)
    image = (on_white - (1 - alpha)[:, None]).clamp(0, 1)
    return torch.where(alpha[:, None] > 0, image, 0.0)
