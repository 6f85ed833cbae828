"""A trained model as it is shown: each frame shaded with what it shows of itself, under any light."""

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.camera import Camera

from ..split_sum import SplitSumLight
from .gbuffer import gbuffer, seen_materials
from .model import Model
from .shading import Shader

Maps = dict[str, Float[Tensor, "height width _"]]


class Renderer:
    """A model under a light, ready to be seen from any camera.

    ``albedo`` is given apart, because relighting scales it.
    """

    def __init__(self, model: Model, albedo: Float[Tensor, "surfels 3"], light: SplitSumLight, shader: Shader) -> None:
        self.model, self.albedo, self.light, self.shader = model, albedo, light, shader

    @torch.no_grad()
    def render(self, camera: Camera) -> Maps:
        """Maps of one view, [height, width, channels], all composited on black.

        image: display sRGB, clipped to [0, 1]. direct, indirect, incident: see ``Shader.shade``. albedo: linear.
        roughness, alpha, depth (world z-depth): one channel. normal: unit in the world, zero where empty.
        """
        seen = seen_materials(camera, self.model.surfels, self.albedo, self.model.metallic)
        shaded = self.shader.shade(gbuffer(camera, seen), seen.alpha, self.light)
        length = seen.normal.square().sum(-1, keepdim=True)
        return {
            **shaded,
            "image": shaded["image"].clamp(0, 1),
            "albedo": seen.images["albedo"],
            "roughness": seen.images["roughness"],
            "alpha": seen.alpha[..., None],
            "normal": seen.normal * torch.where(length > 0, length, torch.inf).rsqrt(),
            "depth": seen.depth[..., None],
        }
