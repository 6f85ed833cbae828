"""What a probe looks at: surfels, their light, the views they are seen from, and the light that arrives at them."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.sampling import LightSampler, hemisphere_directions, relighting_directions
from radiogs_core.transport.splatting import DIFFUSE_DIRECT, SPECULAR_DIRECT, shade_surfels
from radiogs_core.transport.tracer import SurfelTracer, visibility_of

from ..rays import RaySettings

PROBE_OFFSET = 6.66
"""Where a probe's rays start, in standard deviations of their surfel: twice sqrt(2 ln 255), where the opacity of the
densest surfel has fallen to 1/255. Surfels whose footprints overlap sample one surface, and trained ones are tilted
against it: rays that start at one standard deviation, as in training, find 13 % of the sky hidden at the median surfel
of the trained ``convex`` sphere, and leaving that out costs 0.3 dB; from the rim of the footprint 0.17, from here 0.02.
On ``corner`` it costs more than 7 dB wherever they start (docs/effects.md)."""


SHARP_ROUGHNESS = 0.2
"""The roughness that training may still give to any surface; the specular lobe is assessed at it too."""


@dataclass(frozen=True)
class ProbeView:
    """A camera, and the image [height, width, 3] that it took, display sRGB on black; None where there is none."""

    camera: Camera
    target: Float[Tensor, "height width 3"] | None


@dataclass(frozen=True)
class Viewpoints:
    """Where a model is seen from.

    views: those that a probe compares images of. share: how much of all training images each surfel is
    (``image_share``). straight: how images are encoded for display, as in training (``splatting.displayed``).
    """

    views: tuple[ProbeView, ...]
    share: Float[Tensor, " surfels"]
    straight: bool


@dataclass(frozen=True)
class ProbeRays:
    """The rays that a probe traces from every surfel.

    samples: directions spread over the hemisphere. variant: rays as the method's variant traces them, which says how
    low they go and whether they meet surfels from behind. offset: where rays start, in standard deviations; None: where
    those of the variant do. drawn: as many more directions from the light, combined by the balance heuristic; a sun is
    missed by those over the hemisphere.
    """

    samples: int
    generator: torch.Generator
    variant: RaySettings
    offset: float | None = PROBE_OFFSET
    drawn: int = 0

    def tracer(self, surfels: Surfels) -> SurfelTracer:
        """A tracer of these surfels."""
        if self.offset is None:
            return self.variant.tracer(surfels)
        return SurfelTracer(surfels, self.offset, back_offset=self.variant.back_offset)

    def directions(
        self, normal: Float[Tensor, "surfels 3"], light: EnvironmentMap
    ) -> tuple[Float[Tensor, "surfels samples 3"], Float[Tensor, "surfels samples"]]:
        """Unit directions away from surfels with these unit normals, and the solid angles that they stand for."""
        if not self.drawn:
            return hemisphere_directions(normal, self.samples, self.generator, self.variant.floor)
        sampler = LightSampler(light)
        return relighting_directions(normal, sampler, self.samples, self.drawn, self.generator, self.variant.floor)


@dataclass(frozen=True)
class KeptLight:
    """The light that some surfels keep since their rays were left out, and what rays find now.

    mask: which surfels. light and anew: for those alone, along the same directions, so that they differ by time only.
    """

    mask: Bool[Tensor, " surfels"]
    light: Incident
    anew: Incident


@dataclass(frozen=True)
class ProbeScene:
    """A model, the views that it is seen from, and the light that arrives at it; nothing of it has a gradient.

    share, straight: see ``Viewpoints``. incident: traced with everything on. untraced: what stands for it where no rays
    are traced, along the same directions. first: of the incident radiance, what has met one surface only; None where it
    was not traced. sharpest: the roughness that any surface may still be given in training, at which its lobe is
    assessed too; None: materials are final. given_light: the light is not learnt, so that no factor on it is free.
    """

    surfels: Surfels
    environment: Float[Tensor, "rows columns 3"]
    views: tuple[ProbeView, ...]
    share: Float[Tensor, " surfels"]
    straight: bool
    incident: Incident
    untraced: Incident
    first: Float[Tensor, "surfels samples 3"] | None = None
    sharpest: float | None = None
    given_light: bool = False

    @property
    def occlusion(self) -> Float[Tensor, " surfels"]:
        """Share of the cosine-weighted hemisphere from which no distant light comes."""
        cosine = (self.incident.direction * self.surfels.frame[:, None, :, 2]).sum(-1).clamp(min=0)
        flow = cosine * self.incident.weight
        return 1 - (flow * self.incident.visibility).sum(1) / flow.sum(1)


RAYS_AT_ONCE = 1 << 18


@torch.no_grad()
def trace_scene(
    surfels: Surfels,
    environment: Float[Tensor, "rows columns 3"],
    viewpoints: Viewpoints,
    rays: ProbeRays,
    bounces: bool = False,
    among: Int[Tensor, " chosen"] | None = None,
) -> ProbeScene:
    """Trace rays from every surfel; with ``bounces`` once more, to surfaces lit by what the first rays found visible.

    ``among``: trace these surfels only, and leave the others dark.
    """
    surfels = Surfels.of(surfels.plain())
    environment = environment.detach()
    normal = surfels.frame[..., 2]
    direction, weight = rays.directions(normal, EnvironmentMap(environment))
    tracer, every = rays.tracer(surfels), torch.arange(len(surfels), device=normal.device)
    index = every if among is None else among
    seen, radiance, _ = _traced(tracer, index, direction, torch.zeros_like(surfels.albedo))
    traced = ProbeScene(
        surfels, environment, viewpoints.views, viewpoints.share, viewpoints.straight,
        incident=Incident(direction, weight, seen, radiance),
        untraced=tracer.untraced(every, direction, weight),
    )  # fmt: skip
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
    """V, L_ind from the surfels' own radiance, and L_ind if they ``sent`` that radiance; 0 where not traced."""
    visibility = torch.zeros_like(direction[..., 0])
    radiance, features = torch.zeros_like(direction), torch.zeros_like(direction)
    for some in index.split(max(1, RAYS_AT_ONCE // direction.shape[1])) if len(index) else ():
        hits = tracer.trace(some, direction[some], sent)
        seen, whole = visibility_of(hits)
        visibility[some] = seen.view(len(some), -1)
        radiance[some] = (hits.radiance * whole[:, None]).view(len(some), -1, 3)
        features[some] = (hits.features * whole[:, None]).view(len(some), -1, 3)
    return visibility, radiance, features
