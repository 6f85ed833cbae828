"""Shading of surface points under the recovered light and under a new one."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.light_sampler import LightSampler

from .field import Field
from .light import SphericalGaussians, stratified_directions
from .secondary import Arriving, arriving
from .settings import Variant
from .shading import SurfacePoints, transport


@dataclass(frozen=True)
class Shaded:
    """Outgoing radiance of surface points towards the camera, linear."""

    direct: Float[Tensor, "points 3"]
    """Radiance of direct light: reflected once."""
    indirect: Float[Tensor, "points 3"]
    """Radiance of indirect light: reflected more than once."""


@dataclass(frozen=True)
class RecoveredLight:
    """The recovered light, sampled along the same directions at all points."""

    light: SphericalGaussians
    """Distant light."""
    variant: Variant
    """Switches of visibility and indirect light."""
    rows: int
    """Rows of the grid of directions; it has twice as many columns."""
    samples: int
    """Samples of the field along each direction."""
    displaced: bool
    """Whether directions are drawn within their cells, as in training; otherwise they are the cells' middles."""

    def on(self, field: Field, points: SurfacePoints, generator: torch.Generator) -> Shaded:
        """Outgoing radiance of the points. Gradient to materials, normals and light only."""
        drawn = generator if self.displaced else None
        direction, solid_angle = stratified_directions(self.rows, drawn, points.position)
        radiance = self.light.radiance(direction)
        direction = direction.expand(len(points.ray), *direction.shape)
        reflected = transport(points, direction, solid_angle.expand(direction.shape[:2]))
        found = self._arriving(field, points, direction)
        return Shaded((reflected * found.visibility[..., None] * radiance).sum(1), (reflected * found.radiance).sum(1))

    def _arriving(self, field: Field, points: SurfacePoints, direction: Tensor) -> Arriving:
        traced = (points.normal.detach()[:, None] * direction).sum(-1) > 0
        if not (self.variant.visibility or self.variant.indirect):
            traced = torch.zeros_like(traced)
        found = arriving(field, points.position, direction, traced, self.samples, self.variant.indirect)
        return found if self.variant.visibility else Arriving(torch.ones_like(found.visibility), found.radiance)


class NewLight:
    """A new light with constant texels, sampled in proportion to its radiance; direct light only.

    ``count`` directions are drawn for each point, with ``samples`` samples of the field along each if density occludes
    the light (``visibility``). Raises DataError for a light that is not finite.
    """

    def __init__(self, light: EnvironmentMap, count: int, samples: int, visibility: bool) -> None:
        self.radiance, self.count, self.samples, self.visibility = light.radiance, count, samples, visibility
        self.sampler = LightSampler(light)

    def on(self, field: Field, points: SurfacePoints, generator: torch.Generator) -> Shaded:
        """Outgoing radiance of the points; ``indirect`` is zero."""
        direction = self.sampler.draw(len(points.ray), self.count, generator)
        density = self.sampler.pdf(direction)
        weight = torch.where(density > 0, 1 / (self.count * density), 0.0)
        reflected = transport(points, direction, weight)
        incoming = texel_radiance(self.radiance, direction)
        if self.visibility:
            traced = (points.normal[:, None] * direction).sum(-1) > 0
            found = arriving(field, points.position, direction, traced, self.samples, indirect=False)
            incoming = incoming * found.visibility[..., None]
        direct = (reflected * incoming).sum(1)
        return Shaded(direct, torch.zeros_like(direct))


def texel_radiance(
    radiance: Float[Tensor, "height width 3"], direction: Float[Tensor, "*batch 3"]
) -> Float[Tensor, "*batch 3"]:
    """Radiance of the texel that each unit direction lies in (see ``scene.light``), not interpolated."""
    height, width = radiance.shape[:2]
    x, y, z = direction.unbind(-1)
    row = torch.atan2(torch.hypot(x, y), z) * (height / torch.pi)
    column = (0.5 - torch.atan2(y, x) / (2 * torch.pi)) * width
    return radiance[row.long().clamp(0, height - 1), column.long().clamp(0, width - 1)]
