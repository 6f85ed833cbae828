"""The radiance that surface points send out: under the recovered light, and under another one."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.transport.sampling import LightSampler

from .field import Field
from .light import SphericalGaussians, stratified_directions
from .secondary import Arriving, arriving
from .settings import Variant
from .shading import SurfacePoints, transport


@dataclass(frozen=True)
class Shaded:
    """Outgoing radiance of points, linear: after one surface, and after more."""

    direct: Float[Tensor, "points 3"]
    indirect: Float[Tensor, "points 3"]


@dataclass(frozen=True)
class RecoveredLight:
    """The light of training: ``rows`` rows of twice as many directions, the same for all points.

    ``samples``: of the field along each of them. ``displaced``: whether they are drawn within their cells, as training
    does, or the middles of these.
    """

    light: SphericalGaussians
    variant: Variant
    rows: int
    samples: int
    displaced: bool

    def on(self, field: Field, points: SurfacePoints, generator: torch.Generator) -> Shaded:
        """What points send out. Gradient reaches materials, normals and light alone."""
        drawn = generator if self.displaced else None
        direction, solid_angle = stratified_directions(self.rows, drawn, points.place)
        radiance = self.light.radiance(direction)
        direction = direction.expand(len(points.ray), *direction.shape)
        reflected = transport(points, direction, solid_angle.expand(direction.shape[:2]))
        found = self._arriving(field, points, direction)
        return Shaded((reflected * found.visibility[..., None] * radiance).sum(1), (reflected * found.radiance).sum(1))

    def _arriving(self, field: Field, points: SurfacePoints, direction: Tensor) -> Arriving:
        wanted = (points.normal.detach()[:, None] * direction).sum(-1) > 0
        if not (self.variant.visibility or self.variant.indirect):
            wanted = torch.zeros_like(wanted)
        found = arriving(field, points.place, direction, wanted, self.samples, self.variant.indirect)
        return found if self.variant.visibility else Arriving(torch.ones_like(found.visibility), found.radiance)


class NewLight:
    """Another light, from ``count`` directions that are drawn from it for each point; direct light alone.

    The light is constant on each texel. ``visibility``: whether density hides it. Raises DataError for a light that is
    not finite.
    """

    def __init__(self, light: EnvironmentMap, count: int, samples: int, visibility: bool) -> None:
        self.radiance, self.count, self.samples, self.visibility = light.radiance, count, samples, visibility
        self.sampler = LightSampler(light)

    def on(self, field: Field, points: SurfacePoints, generator: torch.Generator) -> Shaded:
        """What points send out of the light itself."""
        direction = self.sampler.draw(len(points.ray), self.count, generator)
        density = self.sampler.pdf(direction)
        weight = torch.where(density > 0, 1 / (self.count * density), 0.0)
        reflected = transport(points, direction, weight)
        incoming = texel_radiance(self.radiance, direction)
        if self.visibility:
            wanted = (points.normal[:, None] * direction).sum(-1) > 0
            seen = arriving(field, points.place, direction, wanted, self.samples, indirect=False).visibility
            incoming = incoming * seen[..., None]
        direct = (reflected * incoming).sum(1)
        return Shaded(direct, torch.zeros_like(direct))


def texel_radiance(
    radiance: Float[Tensor, "height width 3"], direction: Float[Tensor, "*batch 3"]
) -> Float[Tensor, "*batch 3"]:
    """Radiance of the texel that each unit direction lies in (see ``scene.light``), without interpolation."""
    height, width = radiance.shape[:2]
    x, y, z = direction.unbind(-1)
    row = torch.atan2(torch.hypot(x, y), z) * (height / torch.pi)
    column = (0.5 - torch.atan2(y, x) / (2 * torch.pi)) * width
    return radiance[row.long().clamp(0, height - 1), column.long().clamp(0, width - 1)]
