"""Points that training pixels see, and the diffuse light transport to them.

All points share the directions of their rays. Neighbouring points then have the same errors of sampling, which do not
appear in the differences between them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import max_pool2d, normalize

from ..learning.views import TrainingView
from ..scene.colour import srgb_decode
from ..scene.light import bilinear_texels
from ..surfels.surfels import Surfels
from ..transport.plan import EffectPlan
from ..transport.sampling import sphere_directions
from ..transport.splatting import splat
from ..transport.tracer import BACK_OFFSET, EVERYTHING, SurfelTracer, visibility_of

POINTS = 2400
"""Number of points that are drawn from all training views together."""

DIRECTIONS = 2048
"""Directions over the sphere, about 4.5 degrees apart, along which light arrives."""

RAYS_AT_ONCE = 1 << 17
"""Rays that are traced together."""

WHOLE = 0.99
"""Mask coverage from which a pixel shows a single surface."""

OPAQUE = 0.9
"""Coverage by surfels above which a pixel's depth belongs to a single surface."""


@dataclass(frozen=True)
class SeenPoints:
    """Points on surfaces, each seen by a training pixel that shows nothing else."""

    centre: Float[Tensor, "points 3"]
    """Positions in the world."""
    normal: Float[Tensor, "points 3"]
    """Unit normals in the world, facing the camera."""
    radiance: Float[Tensor, "points 3"]
    """Radiance of the pixels, linear RGB."""


@torch.no_grad()
def seen_points(surfels: Surfels, views: Sequence[TrainingView], generator: torch.Generator) -> SeenPoints:
    """Points seen by random pixels that show a single surface, with positions and normals blended from the surfels."""
    samples = []
    for view in views:
        camera = view.camera
        seen = splat(camera, surfels, {}, depth_unit=1.0)
        at_edge = max_pool2d((view.mask < WHOLE).float()[None, None], 3, stride=1, padding=1)[0, 0] > 0
        length = seen.normal.norm(dim=-1)
        usable = torch.nonzero((~at_edge & (seen.alpha > OPAQUE) & (length > 0)).flatten())[:, 0]
        order = torch.randperm(len(usable), generator=generator, device=usable.device)
        chosen = usable[order[: -(-POINTS // len(views))]]
        position = camera.centre + camera.ray_directions() * seen.depth[..., None]
        maps = (position, normalize(seen.normal, dim=-1), srgb_decode(view.image))
        samples.append([values.reshape(-1, 3)[chosen] for values in maps])
    return SeenPoints(*(torch.cat(values) for values in zip(*samples, strict=True)))


@dataclass(frozen=True)
class Light:
    """Light from infinity: a smooth sky, and suns beside it."""

    sky: Float[Tensor, "rows columns 3"]
    """Radiance of the sky, linear RGB, latitude-longitude."""
    suns: Float[Tensor, "suns 3"]
    """Irradiance of a surface that faces each sun, linear RGB."""


@dataclass(frozen=True)
class Transport:
    """Diffuse light transport to points, from the texels of a sky and from suns."""

    rows: int
    """Rows of the sky; it has twice as many columns."""
    direct: Float[Tensor, "points texels"]
    """Radiance of white Lambertian surfaces due to unit radiance in each texel (row * columns + column) of the sky."""
    indirect: Float[Tensor, "points 3"]
    """Their radiance due to light from other surfels, linear RGB."""
    suns: Float[Tensor, "points suns"] | None = None
    """Their radiance due to unit irradiance by each sun of surfaces that face it."""

    def white(self, light: Light) -> Float[Tensor, "points 3"]:
        """Radiance, linear RGB, of white Lambertian surfaces at the points under a light."""
        # Rows of three numbers would take five times as long, and their gradient ten times.
        without = (light.sky.flatten(0, 1).T.contiguous() @ self.direct.T).T + self.indirect
        return without if self.suns is None else without + self.suns @ light.suns

    def with_sun(self, arriving: Float[Tensor, " points"]) -> "Transport":
        """The transport from one more sun."""
        column = arriving[:, None]
        return replace(self, suns=column if self.suns is None else torch.cat([self.suns, column], 1))


@dataclass(frozen=True)
class SharedRays:
    """Rays from points to the surfels, starting beyond the layer of surfels of the points' own surface."""

    surfels: Surfels
    """The surfels that rays hit."""
    two_sided: bool = True
    """Whether rays also hit surfels from behind."""
    plan: EffectPlan = EVERYTHING
    """Without visibility every direction reaches the light, without indirect light no other surfel lights a point, and
    without both no ray is traced."""

    @cached_property
    def tracer(self) -> SurfelTracer:
        """The tracer of the surfels."""
        return SurfelTracer(self.surfels)

    @torch.no_grad()
    def arriving(
        self,
        centre: Float[Tensor, "points 3"],
        normal: Float[Tensor, "points 3"],
        direction: Float[Tensor, "directions 3"],
    ) -> tuple[Float[Tensor, "points directions"], Float[Tensor, "points 3"]]:
        """V cos / pi of each point and unit direction, and the mean over directions of L_ind cos / pi, linear RGB."""
        cosine = (normal @ direction.T).clamp(min=0)
        indirect = torch.zeros_like(centre)
        if not self.plan.traces:
            return cosine / torch.pi, indirect
        received = torch.zeros_like(cosine)
        features = centre.new_zeros(len(self.surfels), 0)
        beyond = BACK_OFFSET * float(self.surfels.scale.max(-1).values.median())
        for some in torch.nonzero(cosine > 0).split(RAYS_AT_ONCE):
            point, along = some.unbind(-1)
            start = centre.new_full((len(some),), beyond)
            hits = self.tracer.trace_from(
                centre[point], direction[along], features, start, start if self.two_sided else None
            )
            visibility, whole = visibility_of(hits)
            share = cosine[point, along] / torch.pi
            received[point, along] = share * visibility if self.plan.visibility else share
            if self.plan.indirect:
                indirect.index_add_(0, point, (share * whole)[:, None] * hits.radiance)
        return received, indirect / len(direction)


def transport_to(
    points: SeenPoints, rays: SharedRays, rows: int
) -> tuple[Transport, Float[Tensor, "points directions"]]:
    """The transport from a sky of ``rows`` rows, without suns; and V cos / pi of each direction of ``sphere``."""
    direction = sphere(points.centre)
    received, indirect = rays.arriving(points.centre, points.normal, direction)
    texel, part = bilinear_texels(direction, rows, 2 * rows)
    of_texels = part.new_zeros(len(direction), 2 * rows * rows).scatter_add(1, texel, part)
    solid = 4 * torch.pi
    direct = received @ of_texels * (solid / len(direction))
    return Transport(rows, direct, solid * indirect), received


def sphere(like: Tensor) -> Float[Tensor, "directions 3"]:
    """The unit directions that all points share. ``like``: same device and type."""
    return sphere_directions(DIRECTIONS).to(like)
