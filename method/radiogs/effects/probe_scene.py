"""The scene of a probe: surfels, views, the light that arrives, and the radiance that leaves under any plan.

All plans are shaded from the same directions, so that they differ only in what they leave out.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.kernels.rasterize.projection import Projection
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.surfels.surfels import Surfels, radiance_to_sh
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.plan import EffectPlan
from radiogs_core.transport.sampling import hemisphere_directions, relighting_directions
from radiogs_core.transport.shading import lambert_albedo
from radiogs_core.transport.splatting import (
    DIFFUSE_DIRECT,
    DIFFUSE_INDIRECT,
    SPECULAR_DIRECT,
    SPECULAR_INDIRECT,
    shade_surfels,
    towards,
)
from radiogs_core.transport.tracer import SurfelTracer, incident_along

from ..rays import RaySettings

PROBE_OFFSET = 6.66
"""Distance from their surfel at which a probe's rays start, in its standard deviations: twice sqrt(2 ln 255), the
distance at which the opacity of the densest surfel has fallen to 1/255. Nearer surfels with overlapping footprints
sample the same surface, which does not occlude itself (docs/effects.md)."""

PROBE_VIEWS = 8
"""Number of training views of a probe: one from each eighth of their list."""


@dataclass(frozen=True)
class ProbeView:
    """A view of a probe."""

    camera: Camera
    target: Float[Tensor, "height width 3"] | None
    """The training image of this camera, display sRGB on black; None without one."""


@dataclass(frozen=True)
class Viewpoints:
    """The views of a probe."""

    views: tuple[ProbeView, ...]
    """The views whose images a probe compares."""
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
    given_light: bool = False
    """Whether the light is given; a learnt light may compensate changes by a factor."""


@torch.no_grad()
def trace_scene(
    surfels: Surfels,
    environment: Float[Tensor, "rows columns 3"],
    viewpoints: Viewpoints,
    rays: ProbeRays,
    bounces: bool = False,
) -> ProbeScene:
    """Traces rays from every surfel along the directions of ``rays``, and returns the scene with this light.

    ``environment``: linear radiance of the light. ``bounces``: whether to also trace ``ProbeScene.first``, for which
    each surfel sends the distant light that it scatters. Raises NumericalFailure if a ray hits a surfel with values
    that are not finite.
    """
    surfels, environment = Surfels.of(surfels.plain()), environment.detach()
    normal = surfels.frame[..., 2]
    direction, weight = rays.directions(normal, EnvironmentMap(environment))
    tracer, every = rays.tracer(surfels), torch.arange(len(surfels), device=normal.device)
    lit = incident_along(tracer, direction, weight)
    untraced = tracer.untraced(every, direction, weight)
    scene = ProbeScene(
        **vars(viewpoints), surfels=surfels, environment=environment, incident=lit, untraced=untraced
    )  # fmt: skip
    if not bounces:
        return scene
    by_light = replace(lit, radiance=torch.zeros_like(direction))
    parts = shade_surfels(surfels, surfels.albedo, by_light, surfels.frame[:, None, :, 2], environment)[:, 0]
    tracer.follow(glowing(surfels, parts[:, DIFFUSE_DIRECT] + parts[:, SPECULAR_DIRECT]))
    return replace(scene, first=incident_along(tracer, direction, weight).radiance)


def glowing(surfels: Surfels, radiance: Float[Tensor, "surfels 3"]) -> Surfels:
    """The surfels with another radiance of their own, linear RGB, the same in all directions."""
    harmonics = torch.cat([radiance_to_sh(radiance)[:, None], torch.zeros_like(surfels.sh[:, 1:])], 1)
    return Surfels.of(surfels.parameters() | {"sh": harmonics})


class PlanRadiance:
    """Outgoing radiance of a scene's surfels towards its views, under any plan.

    Gradients can be compared for ``leaves``. The light is shaded once, for white surfaces; a plan combines the parts
    and multiplies them by the albedo, which also depends on the plan (see ``lambert_albedo``).
    """

    def __init__(self, scene: ProbeScene) -> None:
        self.scene = scene
        surfels = scene.surfels
        self.albedo = surfels.albedo.clone().requires_grad_()
        self.roughness_logit = surfels.roughness_logit.clone().requires_grad_()
        self.environment = scene.environment.clone().requires_grad_()
        self.leaves = {"albedo": self.albedo, "roughness": self.roughness_logit, "light": self.environment}
        self.outgoing = torch.stack([towards(view.camera, surfels) for view in scene.views], 1)

    @cached_property
    def projections(self) -> list[Projection]:
        """The surfels projected into each view."""
        surfels = self.scene.surfels
        return [surfels.seen_by(view.camera, radiance=False) for view in self.scene.views]

    def shaded(self, plan: EffectPlan) -> Float[Tensor, "surfels views 3"]:
        """L_PBR under a plan, linear RGB; a plan without bounces needs ``ProbeScene.first``."""
        parts, free = self._parts
        scattered = parts if plan.bounces else self._first
        by_sky, by_surfels = (parts if plan.visibility else free), (scattered if plan.indirect else free)
        albedo = lambert_albedo(self.albedo, self._materials.roughness, plan.specular_among(self.albedo))
        diffuse = albedo[:, None] * (by_sky[:, :, DIFFUSE_DIRECT] + by_surfels[:, :, DIFFUSE_INDIRECT])
        if not plan.specular:
            return diffuse
        return diffuse + by_sky[:, :, SPECULAR_DIRECT] + by_surfels[:, :, SPECULAR_INDIRECT]

    def own(self, degree: int) -> Float[Tensor, "surfels views 3"]:
        """L_G, the surfels' own radiance, linear RGB, with harmonics up to ``degree``."""
        return surfel_radiance(self.scene.surfels.sh[:, : (degree + 1) ** 2], self.outgoing)

    @cached_property
    def _parts(self) -> tuple[Tensor, Tensor]:
        """The four parts of white surfaces, shaded from traced light, and from its untraced substitute."""
        return self._lit(self.scene.incident), self._lit(self.scene.untraced)

    @cached_property
    def _first(self) -> Tensor:
        assert self.scene.first is not None
        return self._lit(replace(self.scene.incident, radiance=self.scene.first))

    def _lit(self, incident: Incident) -> Float[Tensor, "surfels views 4 3"]:
        white = torch.ones_like(self.albedo)
        return shade_surfels(self._materials, white, incident, self.outgoing, self.environment)

    @property
    def _materials(self) -> Surfels:
        return Surfels.of(self.scene.surfels.parameters() | {"roughness_logit": self.roughness_logit})
