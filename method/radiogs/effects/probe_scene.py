"""The scene of a probe: surfels, their light, the views of them, and the light that arrives at them."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.sampling import hemisphere_directions, relighting_directions
from radiogs_core.transport.splatting import DIFFUSE_DIRECT, SPECULAR_DIRECT, shade_surfels
from radiogs_core.transport.tracer import SurfelTracer, visibility_of

from ..rays import RaySettings

PROBE_OFFSET = 6.66
"""Distance from their surfel at which a probe's rays start, in its standard deviations: twice sqrt(2 ln 255), the
distance at which the opacity of the densest surfel has fallen to 1/255. Nearer surfels with overlapping footprints
sample the same surface, which does not occlude itself (docs/effects.md)."""

SHARP_ROUGHNESS = 0.2
"""A roughness that training may still reach on any surface; the specular lobe is assessed at this roughness too."""


@dataclass(frozen=True)
class ProbeView:
    """A view of a probe."""

    camera: Camera
    target: Float[Tensor, "height width 3"] | None
    """The training image of this camera, display sRGB on black; None if there is none."""


@dataclass(frozen=True)
class Viewpoints:
    """The views of a probe, and each surfel's share of the training images."""

    views: tuple[ProbeView, ...]
    """The views whose images a probe compares."""
    share: Float[Tensor, " surfels"]
    """Share of each surfel in all training images (``image_share``)."""
    straight: bool
    """Whether straight radiance is encoded for display (``kernels.image.display.displayed``), as in training."""


@dataclass(frozen=True)
class ProbeRays:
    """The rays that a probe traces from every surfel."""

    samples: int
    """Number of directions spread over the hemisphere."""
    generator: torch.Generator
    """Draws the directions."""
    variant: RaySettings
    """Rays of the method's variant: how low they go, and whether they hit surfels from behind."""
    offset: float | None = PROBE_OFFSET
    """Distance from their surfel at which rays start, in its standard deviations; None: as in ``variant``."""
    drawn: int = 0
    """Number of additional directions drawn from the light, combined by the balance heuristic.

    Directions over the hemisphere alone miss a sun.
    """

    def tracer(self, surfels: Surfels) -> SurfelTracer:
        """A tracer of these surfels."""
        if self.offset is None:
            return self.variant.tracer(surfels)
        return SurfelTracer(surfels, self.offset, back_offset=self.variant.back_offset)

    def directions(
        self, normal: Float[Tensor, "surfels 3"], light: EnvironmentMap
    ) -> tuple[Float[Tensor, "surfels samples 3"], Float[Tensor, "surfels samples"]]:
        """Unit directions away from surfels with these unit normals, and their solid angles (weights), steradians."""
        if not self.drawn:
            return hemisphere_directions(normal, self.samples, self.generator, self.variant.floor)
        sampler = LightSampler(light)
        return relighting_directions(normal, sampler, self.samples, self.drawn, self.generator, self.variant.floor)


@dataclass(frozen=True)
class KeptLight:
    """The light of surfels without rays: as they keep it, and traced now along the same directions."""

    mask: Bool[Tensor, " surfels"]
    """The surfels that keep their light."""
    light: Incident
    """The light that these surfels keep."""
    anew: Incident
    """The light on these surfels, traced now."""


@dataclass(frozen=True, kw_only=True)
class ProbeScene(Viewpoints):
    """A model, its views, and the light that arrives at it. No tensor has a gradient."""

    surfels: Surfels
    """The surfels with their materials."""
    environment: Float[Tensor, "rows columns 3"]
    """Linear radiance of the distant light, latitude-longitude (see ``scene.light``)."""
    incident: Incident
    """Light that arrives at the surfels, traced with all effects on."""
    untraced: Incident
    """Its substitute without rays, along the same directions."""
    first: Float[Tensor, "surfels samples 3"] | None = None
    """The part of the incident radiance that one surface has scattered, linear RGB; None if it was not traced."""
    sharpest: float | None = None
    """Roughness that training may still reach on any surface, for the specular lobe; None: materials are final."""
    given_light: bool = False
    """Whether the light is given; a learnt light may compensate changes by a factor."""

    @property
    def occlusion(self) -> Float[Tensor, " surfels"]:
        """Share of the cosine-weighted hemisphere in which distant light is occluded."""
        cosine = (self.incident.direction * self.surfels.frame[:, None, :, 2]).sum(-1).clamp(min=0)
        flow = cosine * self.incident.weight
        return 1 - (flow * self.incident.visibility).sum(1) / flow.sum(1)


RAYS_AT_ONCE = 1 << 18
"""Rays that are traced together."""


@torch.no_grad()
def trace_scene(
    surfels: Surfels,
    environment: Float[Tensor, "rows columns 3"],
    viewpoints: Viewpoints,
    rays: ProbeRays,
    bounces: bool = False,
    among: Int[Tensor, " chosen"] | None = None,
) -> ProbeScene:
    """Traces rays from every surfel along the directions of ``rays``, and returns the scene with this light.

    ``environment``: linear radiance of the light. ``bounces``: whether to also trace ``ProbeScene.first``, for which
    each surfel sends the distant light that it scatters. ``among``: indices of the surfels to trace (None: all); the
    others are dark. Raises NumericalFailure if a ray hits a surfel with values that are not finite.
    """
    surfels = Surfels.of(surfels.plain())
    environment = environment.detach()
    normal = surfels.frame[..., 2]
    direction, weight = rays.directions(normal, EnvironmentMap(environment))
    tracer, every = rays.tracer(surfels), torch.arange(len(surfels), device=normal.device)
    index = every if among is None else among
    seen, radiance, _ = _traced(tracer, index, direction, torch.zeros_like(surfels.albedo))
    traced = ProbeScene(
        **vars(viewpoints),
        surfels=surfels,
        environment=environment,
        incident=Incident(direction, weight, seen, radiance),
        untraced=tracer.untraced(every, direction, weight),
    )
    if not bounces:
        return traced
    lit = Incident(direction, weight, seen, torch.zeros_like(direction))
    parts = shade_surfels(surfels, surfels.albedo, lit, surfels.frame[:, None, :, 2], environment)[:, 0]
    once = parts[:, DIFFUSE_DIRECT] + parts[:, SPECULAR_DIRECT]
    return replace(traced, first=_traced(tracer, index, direction, once)[2])


def _traced(
    tracer: SurfelTracer,
    index: Int[Tensor, " chosen"],
    direction: Float[Tensor, "surfels samples 3"],
    sent: Float[Tensor, "surfels 3"],
) -> tuple[Tensor, Tensor, Tensor]:
    """V, L_ind from the surfels' own radiance, and L_ind from the radiance ``sent``; 0 where not traced."""
    visibility = torch.zeros_like(direction[..., 0])
    radiance, features = torch.zeros_like(direction), torch.zeros_like(direction)
    for some in index.split(max(1, RAYS_AT_ONCE // direction.shape[1])) if len(index) else ():
        hits = tracer.trace(some, direction[some], sent)
        seen, whole = visibility_of(hits)
        visibility[some] = seen.view(len(some), -1)
        radiance[some] = (hits.radiance * whole[:, None]).view(len(some), -1, 3)
        features[some] = (hits.features * whole[:, None]).view(len(some), -1, 3)
    return visibility, radiance, features
