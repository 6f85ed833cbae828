"""What a frame knows of the scene: one surface point for each covered pixel, and the depth map around them."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.splatting import SOLID_ALPHA, Splat, splat


@dataclass(frozen=True)
class GBuffer:
    """Linear values of the covered part of each pixel; gradient to albedo, roughness and metallic alone.

    pixel: row * width + column. place: in the camera's space (right, down, forward), world units. normal: unit, in the
    world; zero where blended normals cancel, and such a point is black. outgoing: unit, in the world, towards the
    camera. depth: z-depth of all pixels, world units; infinite where there is no surface.
    """

    camera: Camera
    pixel: Int[Tensor, " points"]
    place: Float[Tensor, "points 3"]
    normal: Float[Tensor, "points 3"]
    outgoing: Float[Tensor, "points 3"]
    albedo: Float[Tensor, "points 3"]
    roughness: Float[Tensor, " points"]
    metallic: Float[Tensor, " points"]
    depth: Float[Tensor, "height width"]

    def __len__(self) -> int:
        return len(self.pixel)

    def image(self, values: Float[Tensor, "points channels"]) -> Float[Tensor, "height width channels"]:
        """Values of the points as an image, zero where nothing is seen."""
        flat = values.new_zeros(self.depth.numel(), values.shape[-1]).index_copy(0, self.pixel, values)
        return flat.view(*self.depth.shape, -1)


def seen_materials(
    camera: Camera,
    surfels: Surfels,
    albedo: Float[Tensor, "surfels 3"],
    metallic: Float[Tensor, " surfels"],
) -> Splat:
    """The blended maps that ``gbuffer`` reads, in one pass. ``albedo`` is given apart: relighting scales it."""
    materials = {"albedo": albedo, "roughness": surfels.roughness[:, None], "metallic": metallic[:, None]}
    return splat(camera, surfels, materials, depth_unit=1.0)


def gbuffer(camera: Camera, seen: Splat) -> GBuffer:
    """The frame that ``seen_materials`` has blended."""
    alpha = seen.alpha.flatten()
    pixel = torch.nonzero(alpha.detach() > 0)[:, 0]
    albedo, roughness, metallic = (
        seen.images[name].flatten(0, 1)[pixel] / alpha[pixel, None] for name in ("albedo", "roughness", "metallic")
    )
    rays = camera.ray_directions().flatten(0, 1)[pixel]
    depth, normal = seen.depth.detach(), seen.normal.detach().flatten(0, 1)[pixel]
    length = normal.square().sum(-1, keepdim=True)
    return GBuffer(
        camera=camera,
        pixel=pixel,
        place=(rays @ camera.axes) * depth.flatten()[pixel, None],
        normal=normal * torch.where(length > 0, length, torch.inf).rsqrt(),
        outgoing=-torch.nn.functional.normalize(rays, dim=-1),
        albedo=albedo,
        roughness=roughness[:, 0],
        metallic=metallic[:, 0],
        depth=torch.where(seen.alpha.detach() >= SOLID_ALPHA, depth, torch.inf),
    )
