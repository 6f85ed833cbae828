"""The scene of a probe: surfels, views, the light that arrives, and the radiance that leaves under any plan.

All plans are shaded from the same directions, so that they differ only in what they leave out.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from radiogs_core.errors import UsageError
from radiogs_core.kernels.rasterize.projection import Projection
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.surfels.surfels import Surfels
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
from radiogs_core.transport.tracer import SurfelTracer, visibility_of

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


class PlanRadiance:
    """Outgoing radiance of a scene's surfels towards its views, under any plan.

    ``albedo``, ``roughness_logit`` and ``environment`` are leaves of the graph, so that gradients can be compared. Each
    set of directions is shaded once, for white surfaces; a plan combines the parts and multiplies them by the albedo,
    which also depends on the plan (see ``lambert_albedo``).
    """

    def __init__(self, scene: ProbeScene) -> None:
        self.scene = scene
        surfels = scene.surfels
        self.albedo = surfels.albedo.clone().requires_grad_()
        self.roughness_logit = surfels.roughness_logit.clone().requires_grad_()
        self.environment = scene.environment.clone().requires_grad_()
        self.outgoing = torch.stack([towards(view.camera, surfels) for view in scene.views], 1)
        self._known: dict[bool, tuple[Tensor, Tensor]] = {}

    @cached_property
    def projections(self) -> list[Projection]:
        """The surfels projected into each view."""
        surfels = self.scene.surfels
        return [surfels.seen_by(view.camera, radiance=False) for view in self.scene.views]

    @property
    def leaves(self) -> dict[str, Tensor]:
        """The tensors whose gradients are compared, by name."""
        return {"albedo": self.albedo, "roughness": self.roughness_logit, "light": self.environment}

    def shaded(self, plan: EffectPlan) -> Float[Tensor, "surfels views 3"]:
        """L_PBR under a plan, linear RGB. Raises UsageError for a plan that the scene was not traced for."""
        traced = plan.traced if plan.traces else False
        shiny = plan.specular_at if plan.specular else False
        parts, free = self._parts(plan.samples > 1)
        by_bounces = parts if plan.bounces else self._first
        occluded, lit = (traced if on else False for on in (plan.visibility, plan.indirect))
        diffuse, specular = (
            _where(occluded, parts[:, :, direct], free[:, :, direct])
            + _where(lit, by_bounces[:, :, indirect], free[:, :, indirect])
            for direct, indirect in ((DIFFUSE_DIRECT, DIFFUSE_INDIRECT), (SPECULAR_DIRECT, SPECULAR_INDIRECT))
        )
        roughness = self._materials.roughness
        albedo = lambert_albedo(self.albedo, roughness, plan.specular_among(self.albedo))
        return albedo[:, None] * diffuse + _where(shiny, specular, 0.0)

    def own(self, degree: int) -> Float[Tensor, "surfels views 3"]:
        """L_G, the surfels' own radiance, linear RGB, with harmonics up to ``degree``."""
        return surfel_radiance(self.scene.surfels.sh[:, : (degree + 1) ** 2], self.outgoing)

    def _parts(self, halved: bool) -> tuple[Tensor, Tensor]:
        """The four parts of white surfaces, shaded from traced light, and from its untraced substitute."""
        if halved not in self._known:
            both = self.scene.incident, self.scene.untraced
            if halved:
                half = both[0].weight.shape[1] // 2
                both = both[0].thinned(half), both[1].thinned(half)
            self._known[halved] = self._lit(both[0]), self._lit(both[1])
        return self._known[halved]

    @cached_property
    def _first(self) -> Tensor:
        if self.scene.first is None:
            raise UsageError(
                "a plan without bounces for a scene that was traced without them",
                "The light scattered by one surface alone was not traced.",
                "Trace the scene with bounces=True.",
            )
        return self._lit(replace(self.scene.incident, radiance=self.scene.first))

    def _lit(self, incident: Incident) -> Float[Tensor, "surfels views 4 3"]:
        white = torch.ones_like(self.albedo)
        return shade_surfels(self._materials, white, incident, self.outgoing, self.environment)

    @property
    def _materials(self) -> Surfels:
        return Surfels.of(self.scene.surfels.parameters() | {"roughness_logit": self.roughness_logit})


def _where(chosen: Bool[Tensor, " surfels"] | bool | None, one: Tensor, other: Tensor | float) -> Tensor:
    """``one`` for the chosen surfels, ``other`` for the rest. ``chosen``: None: all; False: none."""
    if chosen is None:
        return one
    if isinstance(chosen, bool):
        return other if isinstance(other, Tensor) else torch.zeros_like(one)
    return torch.where(chosen[:, None, None], one, other)
