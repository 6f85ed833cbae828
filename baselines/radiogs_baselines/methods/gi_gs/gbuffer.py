"""The G-buffer of a frame: one surface point for each covered pixel, and the depth map of all pixels."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.scene.camera import Camera
from radiogs_core.transport.splatting import SOLID_ALPHA, Splat, splat, unit_or_zero

from ..gs_ir.metallic import MetallicSurfels


@dataclass(frozen=True)
class GBuffer:
    """Surface attributes of the covered pixels; only albedo, roughness and metallic have a gradient.

    Attributes describe the covered part of each pixel: blended values divided by coverage.
    """

    camera: Camera
    """Camera of the frame."""
    pixel: Int[Tensor, " points"]
    """Index of each point's pixel, row * width + column."""
    position: Float[Tensor, "points 3"]
    """Positions in the camera's axes (right, down, forward), relative to its centre, world units."""
    normal: Float[Tensor, "points 3"]
    """Unit normals, world axes; zero where blended normals cancel, and such a point is shaded black."""
    outgoing: Float[Tensor, "points 3"]
    """Unit directions towards the camera, world axes."""
    albedo: Float[Tensor, "points 3"]
    """Linear diffuse albedo."""
    roughness: Float[Tensor, " points"]
    """Perceptual roughness r."""
    metallic: Float[Tensor, " points"]
    """Metalness in [0, 1]."""
    depth: Float[Tensor, "height width"]
    """z-depth of all pixels, world units; infinite for a pixel without surface."""

    def __len__(self) -> int:
        return len(self.pixel)

    def image(self, values: Float[Tensor, "points channels"]) -> Float[Tensor, "height width channels"]:
        """Scatter values of the points into an image; pixels without a point are zero."""
        flat = values.new_zeros(self.depth.numel(), values.shape[-1]).index_copy(0, self.pixel, values)
        return flat.view(*self.depth.shape, -1)


def seen_materials(camera: Camera, model: MetallicSurfels, albedo: Float[Tensor, "surfels 3"]) -> Splat:
    """Blend the maps that ``gbuffer`` reads, in one pass; a model without metalness has the metalness 0.

    ``albedo`` is linear; it is a separate parameter because relighting scales the recovered albedo.
    """
    surfels, metallic = model.surfels, model.metallic
    if metallic is None:
        metallic = torch.zeros_like(surfels.roughness_logit)
    materials = {"albedo": albedo, "roughness": surfels.roughness[:, None], "metallic": metallic[:, None]}
    return splat(camera, surfels, materials, depth_unit=1.0)


def gbuffer(camera: Camera, seen: Splat) -> GBuffer:
    """Build the G-buffer from the maps of ``seen_materials``."""
    alpha = seen.alpha.flatten()
    pixel = torch.nonzero(alpha.detach() > 0)[:, 0]
    albedo, roughness, metallic = (
        seen.images[name].flatten(0, 1)[pixel] / alpha[pixel, None] for name in ("albedo", "roughness", "metallic")
    )
    rays = camera.ray_directions().flatten(0, 1)[pixel]
    depth = seen.depth.detach()
    return GBuffer(
        camera=camera,
        pixel=pixel,
        position=(rays @ camera.axes) * depth.flatten()[pixel, None],
        normal=unit_or_zero(seen.normal.detach().flatten(0, 1)[pixel]),
        outgoing=-torch.nn.functional.normalize(rays, dim=-1),
        albedo=albedo,
        roughness=roughness[:, 0],
        metallic=metallic[:, 0],
        depth=torch.where(seen.alpha.detach() >= SOLID_ALPHA, depth, torch.inf),
    )
