"""Surfels under lamps: one ray from each surfel to each lamp, so that direct light has no noise, and interreflection.

Lamps have no size: shadows are as sharp as surfels are small, and no camera sees a lamp.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ..contract import Maps
from ..errors import UsageError
from ..kernels.surfel.geometry import TRACE_TRANSMITTANCE_STOP
from ..scene.camera import Camera
from ..scene.lamps import Lamp
from ..scene.light import EnvironmentMap
from ..surfels.surfels import Surfels
from .incident import Incident, unoccluded
from .interreflection import KEPT_BYTES, FixedRays, add_bounces, reflectance_of, sent_by_lambert
from .maps import maps_of_light
from .splatting import shade_surfels, towards
from .tracer import RAYS_AT_ONCE, SurfelTracer


class LitByLamps:
    """Shades every surfel under lamps and a map, whose light is traced once; the BRDF is evaluated for every camera.

    ``incident``: light of the map and of all interreflection. ``lamps``: see ``lamp_light``. ``straight``: see
    ``displayed``.
    """

    def __init__(
        self,
        surfels: Surfels,
        albedo: Float[Tensor, "surfels 3"],
        light: EnvironmentMap,
        incident: Incident,
        lamps: Incident,
        straight: bool,
    ) -> None:
        self.surfels, self.albedo, self.light = surfels.with_cached_values(), albedo, light
        self.incident, self.lamps, self.straight = incident, lamps, straight

    @torch.no_grad()
    def render(self, camera: Camera, *further: str) -> Maps:
        """The maps of ``on_surfels.trained.Renderer``; the lamps' unscattered light counts as ``direct``."""
        outgoing = towards(camera, self.surfels)[:, None]
        (direct, indirect), (_, from_lamps) = (
            shade_surfels(self.surfels, self.albedo, arriving, outgoing, self.light.radiance)[:, 0]
            .unflatten(1, (2, 2))  # diffuse and specular, each direct and indirect
            .sum(1)
            .unbind(1)
            for arriving in (self.incident, self.lamps)
        )
        return maps_of_light(camera, self.surfels, self.albedo, direct + from_lamps, indirect, self.straight)


@torch.no_grad()
def lit_by_lamps(
    tracer: SurfelTracer,
    albedo: Float[Tensor, "surfels 3"],
    lamps: Sequence[Lamp],
    light: EnvironmentMap,
    directions: tuple[Float[Tensor, "surfels samples 3"], Float[Tensor, "surfels samples"]],
    bounces: int,
    straight: bool,
) -> LitByLamps:
    """The tracer's surfels under lamps and a map, ready to be rendered, with the interreflection of ``bounces``.

    ``albedo``: linear, used instead of that of the surfels. ``light``: distant light, black for none. ``directions``:
    unit directions and their solid angles, for the map and interreflection. Raises UsageError as ``lamp_light`` does.
    """
    surfels, shone = tracer.surfels, lamp_light(tracer, lamps)
    incident, reflectance = unoccluded(*directions), reflectance_of(surfels, albedo)
    rays = FixedRays(tracer, torch.arange(len(albedo), device=albedo.device), directions[0], KEPT_BYTES)
    rays.fill_visibility(incident)
    by_map, by_lamps = (sent_by_lambert(surfels, reflectance, each, light.radiance) for each in (incident, shone))
    add_bounces(rays, incident, reflectance, by_map + by_lamps, bounces)
    return LitByLamps(surfels, albedo, light, incident, shone, straight)


@torch.no_grad()
def lamp_light(tracer: SurfelTracer, lamps: Sequence[Lamp]) -> Incident:
    """The lamps' light on every surfel: a direction for each lamp, with a solid angle of 1.

    ``radiance`` is therefore the irradiance at normal incidence, linear RGB, after blockers; the map's light is not in
    it (``visibility`` is 0). Raises UsageError for a lamp whose irradiance is beyond float32.
    """
    points = tracer.surfels.centre.detach()
    found = [lamp.light_at(points.double()) for lamp in lamps]
    direction, distance, irradiance = (torch.stack([each[part] for each in found], 1).to(points) for part in range(3))
    if not irradiance.isfinite().all():
        lamp = int(torch.nonzero(~irradiance.isfinite())[0, 1])
        raise UsageError(
            f"lamp {lamp + 1} of {len(lamps)} gives a surfel an irradiance beyond 32 bits",
            "It lies on the surfel, or its light is too strong.",
            "Move it away from the surfaces, or make it weaker.",
        )
    every = torch.arange(len(points), device=points.device)
    seen = torch.cat(
        [seen_lamps(tracer, some, direction[some], distance[some])
         for some in every.split(max(1, RAYS_AT_ONCE // len(lamps)))]
    )  # fmt: skip
    return Incident(direction, torch.ones_like(distance), torch.zeros_like(distance), irradiance * seen[..., None])


def seen_lamps(
    tracer: SurfelTracer,
    index: Int[Tensor, " chosen"],
    direction: Float[Tensor, "chosen lamps 3"],
    distance: Float[Tensor, "chosen lamps"],
) -> Float[Tensor, "chosen lamps"]:
    """Visibility of lamps (``tracer.visibility_of``), by the hits that are nearer than the lamps."""
    lists = tracer.hits(index, direction)
    ray = lists.ray.long().repeat_interleave(lists.begin.diff())
    nearer = lists.depth < distance.flatten()[ray]
    # float64 keeps the digits of a product of many faint hits, as in ``path_tracing.drawn_hit``.
    blocked = torch.zeros_like(distance, dtype=torch.float64).flatten()
    blocked.index_add_(0, ray[nearer], torch.log1p(-lists.alpha[nearer].double()))
    transmittance = blocked.exp()
    return torch.where(transmittance < TRACE_TRANSMITTANCE_STOP, 0.0, transmittance).to(distance).view_as(distance)
