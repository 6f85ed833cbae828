"""What is probed: a model, where it is looked at from, and the light that arrives at it."""

from dataclasses import dataclass

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

PROBE_OFFSET = 6.66
"""Where a probe's rays start, in standard deviations of their surfel: twice sqrt(2 ln 255), where the opacity of the
densest surfel has fallen to 1/255. Surfels whose footprints overlap are one surface seen again, and trained ones lie
askew: started at one standard deviation, as in training, rays of the trained ``convex`` sphere find 13 % of the sky
hidden at the median surfel, and leaving that out costs 0.3 dB; from the rim of the footprint 0.17, from here 0.02. On
``corner`` it costs more than 7 dB from wherever they start (docs/effects.md)."""


SHARP_ROUGHNESS = 0.2
"""What training may still make of any surface: the roughness at which lobes are judged besides the present one."""


@dataclass(frozen=True)
class ProbeView:
    """A camera, and the display-sRGB image [height, width, 3] on black that it saw; None where there is none."""

    camera: Camera
    target: Float[Tensor, "height width 3"] | None


@dataclass(frozen=True)
class KeptLight:
    """The light that some surfels have kept since rays were taken from them, and what rays find now.

    mask: which surfels. light and anew: of those alone, along the same directions, so that only time differs.
    """

    mask: Bool[Tensor, " surfels"]
    light: Incident
    anew: Incident


@dataclass(frozen=True)
class ProbeScene:
    """A model ready to be probed.

    surfels, environment (linear radiance, lat-long): as they are. sights: from where. share: of the pictures that there
    are, what part each surfel is (``image_share``). incident: V and L_ind of all surfels along the probe's directions.
    untraced: what stands for them without rays, along the same. first: L_ind of light that has met one surface alone;
    None where it was not asked for. sharpest: the roughness that any surface may yet be learnt to have, at which its
    lobe is judged besides; None: materials are final. given_light: the light is not learnt, so that no factor on it is
    free.
    """

    surfels: Surfels
    environment: Float[Tensor, "rows columns 3"]
    sights: tuple[ProbeView, ...]
    share: Float[Tensor, " surfels"]
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
    sights: tuple[ProbeView, ...],
    share: Float[Tensor, " surfels"],
    samples: int,
    generator: torch.Generator,
    bounces: bool = False,
    offset: float = PROBE_OFFSET,
    drawn: int = 0,
    among: Int[Tensor, " chosen"] | None = None,
) -> ProbeScene:
    """Trace ``samples`` directions of every surfel; with ``bounces`` once more, to surfaces lit by what was visible.

    ``drawn``: as many more from the light, by the balance heuristic: a sun is missed by those over the hemisphere.
    ``among``: trace these surfels only, and leave the others dark.
    """
    surfels = Surfels.of({name: value.detach() for name, value in surfels.parameters().items()})
    environment = environment.detach()
    normal = surfels.frame[..., 2]
    direction, weight = hemisphere_directions(normal, samples, generator)
    if drawn:
        sampler = LightSampler(EnvironmentMap(environment))
        direction, weight = relighting_directions(normal, sampler, samples, drawn, generator)
    tracer, every = SurfelTracer(surfels, offset), torch.arange(len(surfels), device=normal.device)
    index = every if among is None else among
    seen, radiance, _ = _traced(tracer, index, direction, torch.zeros_like(surfels.albedo))
    incident = Incident(direction, weight, seen, radiance)
    untraced = tracer.untraced(every, direction, weight)
    if not bounces:
        return ProbeScene(surfels, environment, sights, share, incident, untraced)
    lit = Incident(direction, weight, seen, torch.zeros_like(direction))
    parts = shade_surfels(surfels, surfels.albedo, lit, surfels.frame[:, None, :, 2], environment)[:, 0]
    once = parts[:, DIFFUSE_DIRECT] + parts[:, SPECULAR_DIRECT]
    first = _traced(tracer, index, direction, once)[2]
    return ProbeScene(surfels, environment, sights, share, incident, untraced, first)


def _traced(
    tracer: SurfelTracer,
    index: Int[Tensor, " chosen"],
    direction: Float[Tensor, "surfels samples 3"],
    sent: Float[Tensor, "surfels 3"],
) -> tuple[Tensor, Tensor, Tensor]:
    """V, L_ind of the surfels' own radiance, and L_ind if they ``sent`` that radiance to all sides; of the rest 0."""
    visibility = torch.zeros_like(direction[..., 0])
    radiance, features = torch.zeros_like(direction), torch.zeros_like(direction)
    for some in index.split(max(1, RAYS_AT_ONCE // direction.shape[1])) if len(index) else ():
        hits = tracer.trace(some, direction[some], sent)
        seen, whole = visibility_of(hits)
        visibility[some] = seen.view(len(some), -1)
        radiance[some] = (hits.radiance * whole[:, None]).view(len(some), -1, 3)
        features[some] = (hits.features * whole[:, None]).view(len(some), -1, 3)
    return visibility, radiance, features
