"""A trained model as it is shown: vertices shaded from a table, under the recovered light or another one."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.kernels.image.display import displayed
from radiogs_core.kernels.rasterize.rasterize import project
from radiogs_core.scene.camera import Camera
from radiogs_core.transport.splatting import splat, towards

from .model import Model
from .shading import Materials, shade_vertices
from .table import Table
from .vertices import blend_vertices

Maps = dict[str, Float[Tensor, "height width _"]]


@dataclass(frozen=True)
class Lit:
    """What vertices are lit by: the light as it is looked up, and the table, whose radiance counts ``factor`` times."""

    environment: Float[Tensor, "rows columns 3"]
    table: Table
    factor: Float[Tensor, ""] | float


class Renderer:
    """A model under a light, ready to be seen from any camera.

    ``materials``: what the camera sees (see ``shading.materials_of``). ``distance``: of the vertices. ``straight``: see
    ``splatting.displayed``.
    """

    def __init__(self, model: Model, materials: Materials, lit: Lit, distance: float, straight: bool = True) -> None:
        self.model, self.materials, self.lit = model, materials.detach(), lit
        self.distance, self.straight = distance, straight

    @torch.no_grad()
    def render(self, camera: Camera) -> Maps:
        """Maps of one view, [height, width, channels], all composited on black.

        image: display sRGB, clipped to [0, 1]. direct, indirect: linear outgoing radiance. incident: mean over each
        surfel's hemisphere of the indirect radiance that arrives. albedo: linear. roughness, alpha, depth (world
        z-depth): one channel. normal: that of the vertices, unit in the world, zero where empty.
        """
        surfels = self.model.surfels
        camera = camera.to(surfels.centre.device, surfels.centre.dtype)
        seen = splat(camera, surfels, {}, depth_unit=1.0)
        projection = project(camera, surfels.geometry_for(camera))
        shaded = self._shaded(camera, torch.nonzero(projection.lists.touched)[:, 0])
        blended = blend_vertices(projection, surfels, torch.cat([shaded, self.materials], -1), self.distance)
        direct, indirect, incident, albedo, roughness, normal = blended.split([3, 3, 3, 3, 1, 3], -1)
        length = normal.square().sum(-1, keepdim=True)
        return {
            "image": displayed(direct + indirect, seen.alpha, self.straight).clamp(0, 1),
            "direct": direct,
            "indirect": indirect,
            "incident": incident,
            "albedo": albedo,
            "roughness": roughness,
            "alpha": seen.alpha[..., None],
            "normal": normal * torch.where(length > 0, length, torch.inf).rsqrt(),
            "depth": seen.depth[..., None],
        }

    def _shaded(self, camera: Camera, index: Tensor) -> Float[Tensor, "surfels vertices 9"]:
        """Direct, indirect and incident radiance of the vertices in view, zero for the others."""
        incident = self.lit.table.incident(index, self.lit.factor)
        outgoing = towards(camera, self.model.surfels)[index]
        direct, indirect = shade_vertices(self.materials[index], incident, outgoing, self.lit.environment)
        weight = incident.weight[..., None]
        arriving = (weight * incident.radiance).sum(1) / weight.sum(1)
        shaded = torch.cat([direct, indirect, arriving[:, None].expand_as(direct)], -1)
        return shaded.new_zeros(*self.materials.shape[:2], 9).index_copy(0, index, shaded)
