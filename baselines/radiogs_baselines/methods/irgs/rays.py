"""The light that arrives at seen points, traced through the surfels: visibility, and radiance by their harmonics."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.kernels.trace.trace import Hits
from radiogs_core.on_surfels.seen_points import SeenPoints
from radiogs_core.transport.hit_surface import hit_radiance
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.splitsum import PrefilteredLight
from radiogs_core.transport.tracer import BACK_OFFSET, SELF_OFFSET, SurfelTracer, visibility_of

from .settings import Indirect, Variant


@dataclass(frozen=True)
class Rays:
    """Where rays from a point start, and whether they meet surfels from behind (see ``Variant``).

    start: world units; None: in the standard deviation of the surfels that the pixel sees.
    """

    start: float | None = None
    two_sided: bool = True

    @classmethod
    def of(cls, variant: Variant, extent: float) -> "Rays":
        """Those of a variant; ``extent``: the scene's, world units."""
        return cls(None if variant.ray_start is None else variant.ray_start * extent, variant.two_sided)

    def trace(
        self,
        tracer: SurfelTracer,
        points: SeenPoints,
        direction: Float[Tensor, "points samples 3"],
        features: Float[Tensor, "surfels channels"],
    ) -> Hits:
        """Rays from the points; flattened to [points * samples]."""
        samples = direction.shape[1]
        width = points.width.repeat_interleave(samples)
        start = SELF_OFFSET * width if self.start is None else torch.full_like(width, self.start)
        return tracer.trace_from(
            points.position.repeat_interleave(samples, 0), direction.flatten(0, 1), features,
            start, BACK_OFFSET * width if self.two_sided else None,
        )  # fmt: skip

    def incident(
        self,
        tracer: SurfelTracer,
        points: SeenPoints,
        direction: Float[Tensor, "points samples 3"],
        weight: Float[Tensor, "points samples"],
        indirect: Indirect,
    ) -> Incident:
        """V = 1 - A and L_ind = sum_i T_i alpha_i SH_i, with gradient to what ``indirect`` says.

        "detached" cuts the gradient of L_ind alone; V keeps it, and has some where geometry is learnt.
        """
        hits = self.trace(tracer, points, direction, tracer.geometry.centre.new_zeros(len(tracer.geometry), 0))
        visibility, whole = visibility_of(hits)
        radiance = (hits.radiance * whole[:, None]).view(direction.shape)
        if indirect == "detached":
            radiance = radiance.detach()
        elif indirect == "none":
            radiance = torch.zeros_like(direction)
        return Incident(direction, weight, visibility.view(weight.shape), radiance)

    def relit(
        self,
        tracer: SurfelTracer,
        points: SeenPoints,
        direction: Float[Tensor, "points samples 3"],
        weight: Float[Tensor, "points samples"],
        features: Float[Tensor, "surfels 7"],
        light: PrefilteredLight,
    ) -> Incident:
        """V, and L_ind as the split sum at what rays meet (``hit_surface``): the harmonics belong to another light."""
        hits = self.trace(tracer, points, direction, features)
        seen, radiance = hit_radiance(hits, direction.flatten(0, 1), light)
        return Incident(direction, weight, seen.view(weight.shape), radiance.view(direction.shape))
