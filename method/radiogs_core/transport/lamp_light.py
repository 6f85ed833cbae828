"""Surfels under lamps: one ray from each surfel to each lamp, so that direct light has no noise.

Lamps have no size: shadows are as sharp as surfels are small, and no camera sees a lamp.
"""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ..contract import Maps, Prepared, Trained
from ..errors import UsageError
from ..kernels.image.display import displayed
from ..kernels.surfel.geometry import TRACE_TRANSMITTANCE_STOP
from ..scene.camera import Camera
from ..scene.lamps import Lamp
from ..scene.light import EnvironmentMap
from ..surfels.surfels import Surfels
from .incident import Incident
from .splatting import DIFFUSE_INDIRECT, SPECULAR_INDIRECT, shade_surfels, splat, towards
from .tracer import RAYS_AT_ONCE, SurfelTracer


@runtime_checkable
class RelitByLamps(Protocol):
    """A method that can render a trained model under lamps, for ``radiogs-bench relight --point``.

    It is not in ``capabilities``, which training imports: no model is trained anew for a change here.
    """

    def relit_by_lamps(
        self, trained: Trained, lamps: Sequence[Lamp], light: EnvironmentMap | None, albedo_scale: Float[Tensor, "3"]
    ) -> Prepared:
        """The model under lamps and, unless it is None, a map of distant light.

        ``albedo_scale``: see ``Trained.prepare``. Raises DataError for a map that is not finite, UsageError as
        ``lamp_light`` does.
        """


@torch.no_grad()
def lamp_light(tracer: SurfelTracer, lamps: Sequence[Lamp]) -> Incident:
    """The lamps' light on every surfel: a direction for each lamp, with a solid angle of 1.

    ``radiance`` is therefore the irradiance at normal incidence, linear RGB, after blockers; the map's light is not in
    it (``visibility`` is 0). Raises UsageError for a lamp whose irradiance is beyond float32.
    """
    points = tracer.surfels.centre.detach()
    found = zip(*(lamp.light_at(points.double()) for lamp in lamps), strict=True)
    direction, distance, irradiance = (torch.stack(each, 1).to(points) for each in found)
    if not irradiance.isfinite().all():
        lamp = int(torch.nonzero(~irradiance.isfinite())[0, 1])
        raise UsageError(
            f"lamp {lamp + 1} of {len(lamps)} gives a surfel an irradiance beyond 32 bits",
            "It lies on the surfel, or its light is too strong.",
            "Move it away from the surfaces, or make it weaker.",
        )
    parts = torch.arange(len(points), device=points.device).split(max(1, RAYS_AT_ONCE // len(lamps)))
    seen = torch.cat([seen_lamps(tracer, some, direction[some], distance[some]) for some in parts])
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


@torch.no_grad()
def with_lamps(
    maps: Maps, camera: Camera, surfels: Surfels, albedo: Float[Tensor, "surfels 3"], lamps: Incident, straight: bool
) -> Maps:
    """``maps.shaded_maps`` with the light of lamps (``lamp_light``) in ``direct`` and ``image``."""
    dark, outgoing = albedo.new_zeros(1, 1, 3), towards(camera, surfels)[:, None]
    parts = shade_surfels(surfels, albedo, lamps, outgoing, dark)[:, 0]
    channels = {"lamps": parts[:, DIFFUSE_INDIRECT] + parts[:, SPECULAR_INDIRECT]}
    direct = maps["direct"] + splat(camera, surfels, channels, depth_unit=1.0).images["lamps"]
    image = displayed(direct + maps["indirect"], maps["alpha"][..., 0], straight).clamp(0, 1)
    return {**maps, "direct": direct, "image": image}


def extent_of(surfels: Surfels) -> str:
    """A sentence on where surfels lie in the world, for who places lamps among them; 2 % along each axis may stray."""
    centre = surfels.centre.detach().sort(0).values
    low, high = (centre[round(share * (len(centre) - 1))].tolist() for share in (0.01, 0.99))
    axes = (f"{name} {a:.3g} to {b:.3g}" for name, a, b in zip("xyz", low, high, strict=True))
    return f"the model lies in {', '.join(axes)} of the scene's world"
