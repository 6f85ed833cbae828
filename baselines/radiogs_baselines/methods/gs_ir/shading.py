"""What a camera sees of a model, shaded: materials blended into maps, and one split sum at each covered pixel.

L_o = a (O E(n) + (1 - O) I) + S (F0 A + B): O occludes the diffuse part alone. Normals and places have no gradient.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.kernels.image.display import displayed
from radiogs_core.on_surfels.seen_points import SeenPoints, covered_pixels, seen_points, seen_surfels
from radiogs_core.on_surfels.split_sum import SplitSumLight
from radiogs_core.scene.camera import Camera
from radiogs_core.transport.splatting import Splat

from .model import Model


@dataclass(frozen=True)
class Shaded:
    """Outgoing radiance of points towards the camera, linear: after one surface, and after more."""

    direct: Float[Tensor, "points 3"]
    indirect: Float[Tensor, "points 3"]

    @property
    def radiance(self) -> Float[Tensor, "points 3"]:
        """All of it."""
        return self.direct + self.indirect


def shade_points(
    points: SeenPoints,
    light: SplitSumLight,
    openness: Float[Tensor, " points"] | None = None,
    irradiance: Float[Tensor, " points"] | None = None,
    metallic: Float[Tensor, " points"] | None = None,
) -> Shaded:
    """The points under a light; zero where the camera looks from below the surface.

    openness: O, None: 1. irradiance: I, over pi and gray, None: 0. metallic: None: F0 = 0.04.
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
    """The blended maps of a view, and the surface points of its covered pixels, row * width + column.

    metallic: of the points; None where the model has none.
    """

    seen: Splat
    pixels: Int[Tensor, " points"]
    points: SeenPoints
    metallic: Float[Tensor, " points"] | None

    @classmethod
    def of(cls, camera: Camera, model: Model, albedo: Float[Tensor, "surfels 3"], depth_unit: float = 1.0) -> "View":
        """What ``camera`` sees; ``albedo`` is given apart, because relighting scales it."""
        metallic = model.metallic
        further = {} if metallic is None else {"metallic": metallic[:, None]}
        seen = seen_surfels(camera, model.surfels, albedo, further, depth_unit)
        pixels = covered_pixels(seen)
        points = seen_points(camera, seen, pixels)
        if metallic is None:
            return cls(seen, pixels, points, None)
        blended = seen.images["metallic"].flatten()[pixels] / seen.alpha.flatten()[pixels]
        return cls(seen, pixels, points, blended)

    def shaded(self, model: Model, light: SplitSumLight, samples: int) -> Shaded:
        """The points under the model's own light, with its volumes; O from ``samples`` directions."""
        place, normal = self.points.position.detach(), self.points.normal.detach()
        openness = None if model.occlusion is None else model.occlusion.openness(place, normal, samples)
        irradiance = None if model.irradiance is None else model.irradiance.at(place, normal)
        return shade_points(self.points, light, openness, irradiance, self.metallic)

    def relit(self, light: SplitSumLight) -> Shaded:
        """The points under another light: neither occluded nor with indirect light."""
        return shade_points(self.points, light, metallic=self.metallic)

    def map_of(self, values: Float[Tensor, "points 3"]) -> Float[Tensor, "height width 3"]:
        """Values of the points as a map, multiplied by coverage."""
        alpha = self.seen.alpha
        straight = values.new_zeros(alpha.numel(), 3).index_copy(0, self.pixels, values)
        return straight.view(*alpha.shape, 3) * alpha[..., None]

    def image(self, shaded: Shaded, straight: bool) -> Float[Tensor, "height width 3"]:
        """Display sRGB on black, not clipped (see ``splatting.displayed``)."""
        return displayed(self.map_of(shaded.radiance), self.seen.alpha, straight)
