"""Deferred shading of a view: materials are blended into maps, and each covered pixel is shaded by one split sum.

L_o = a (O E(n) + (1 - O) I) + S (F0 A + B): O occludes only the diffuse part. Normals and positions have no gradient.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.kernels.image.display import displayed
from radiogs_core.on_surfels.seen_points import SeenPoints, Shaded, covered_pixels, seen_points, seen_surfels
from radiogs_core.on_surfels.split_sum_light import SplitSumLight
from radiogs_core.scene.camera import Camera
from radiogs_core.transport.splatting import Splat

from .model import Model


def shade_points(
    points: SeenPoints,
    light: SplitSumLight,
    openness: Float[Tensor, " points"] | None = None,
    irradiance: Float[Tensor, " points"] | None = None,
    metallic: Float[Tensor, " points"] | None = None,
) -> Shaded:
    """Shade points under a light; zero where the camera is below the surface.

    ``openness``: O in [0, 1]; None: 1. ``irradiance``: grey indirect irradiance over pi, I, linear; None: 0.
    ``metallic``: metalness in [0, 1]; None: F0 = 0.04.
    """
    normal, outgoing = points.normal.detach(), points.outgoing
    reflected = light.reflected(normal, outgoing, points.albedo, points.roughness, metallic)
    if openness is None:
        return Shaded(reflected.radiance, torch.zeros_like(reflected.diffuse))
    direct = reflected.occluded(openness)
    if irradiance is None:
        return Shaded(direct, torch.zeros_like(direct))
    arriving = torch.where((normal * outgoing).sum(-1) > 0, (1 - openness) * irradiance, 0.0)
    return Shaded(direct, points.albedo * arriving[:, None])


@dataclass(frozen=True)
class View:
    """The blended maps of a view, and the surface points of its covered pixels."""

    seen: Splat
    """Blended maps."""
    pixels: Int[Tensor, " points"]
    """Indices of the covered pixels, row * width + column."""
    points: SeenPoints
    """Surface points of the covered pixels."""
    metallic: Float[Tensor, " points"] | None
    """Metalness of the points; None if the model has none."""

    @classmethod
    def of(cls, camera: Camera, model: Model, albedo: Float[Tensor, "surfels 3"], depth_unit: float = 1.0) -> "View":
        """Blend the maps of ``camera``. ``albedo`` (linear) may differ from the model's: relighting scales it."""
        metallic = model.metallic
        further = {} if metallic is None else {"metallic": metallic[:, None]}
        seen = seen_surfels(camera, model.surfels, albedo, further, depth_unit)
        pixels = covered_pixels(seen)
        if metallic is not None:
            metallic = seen.images["metallic"].flatten()[pixels] / seen.alpha.flatten()[pixels]
        return cls(seen, pixels, seen_points(camera, seen, pixels), metallic)

    def shaded(self, model: Model, light: SplitSumLight, samples: int) -> Shaded:
        """Shade the points with the model's volumes; O is the mean over ``samples`` directions."""
        position, normal = self.points.position.detach(), self.points.normal.detach()
        openness = None if model.occlusion is None else model.occlusion.openness(position, normal, samples)
        irradiance = None if model.irradiance is None else model.irradiance.at(position, normal)
        return shade_points(self.points, light, openness, irradiance, self.metallic)

    def relit(self, light: SplitSumLight) -> Shaded:
        """Shade the points under another light, without occlusion and indirect light."""
        return shade_points(self.points, light, metallic=self.metallic)

    def map_of(self, values: Float[Tensor, "points 3"]) -> Float[Tensor, "height width 3"]:
        """Scatter values of the points into a map, multiplied by coverage."""
        alpha = self.seen.alpha
        straight = values.new_zeros(alpha.numel(), 3).index_copy(0, self.pixels, values)
        return straight.view(*alpha.shape, 3) * alpha[..., None]

    def image(self, shaded: Shaded, straight: bool) -> Float[Tensor, "height width 3"]:
        """Display-sRGB image on black, not clipped (see ``display.displayed``)."""
        return displayed(self.map_of(shaded.radiance), self.seen.alpha, straight)
