"""Incident light of surface points, traced through the surfels, and the points' Monte Carlo shading by it.

L_o = sum_i w_i (a / pi + f_s) (V L_env + L_ind) (n.w_i).
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.kernels.trace.trace import Hits
from radiogs_core.on_surfels.seen_points import SeenPoints, Shaded
from radiogs_core.transport.hit_surface import hit_radiance
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.prefiltered_light import PrefilteredLight
from radiogs_core.transport.shading import shade_materials
from radiogs_core.transport.splatting import DIFFUSE_DIRECT, DIFFUSE_INDIRECT, SPECULAR_DIRECT, SPECULAR_INDIRECT
from radiogs_core.transport.tracer import BACK_OFFSET, SELF_OFFSET, SurfelTracer, visibility_of

from .settings import Indirect, Variant


@dataclass(frozen=True)
class RaySettings:
    """How rays from surface points are traced."""

    start: float | None = None
    """Distance from the point at which rays start, world units; None: one standard deviation of the pixel's surfels."""
    two_sided: bool = True
    """Whether rays hit surfels from behind, too (see ``Variant.two_sided``)."""

    @classmethod
    def of(cls, variant: Variant, extent: float) -> "RaySettings":
        """Ray settings of a variant; ``extent``: the scene's extent, world units."""
        return cls(None if variant.ray_start is None else variant.ray_start * extent, variant.two_sided)

    def trace(
        self,
        tracer: SurfelTracer,
        points: SeenPoints,
        direction: Float[Tensor, "points samples 3"],
        features: Float[Tensor, "surfels channels"],
    ) -> Hits:
        """Trace rays from the points along unit world directions; the hits are flattened to [points * samples]."""
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
        """Trace V = 1 - A and L_ind = sum_i T_i alpha_i SH_i (linear), with the gradients that ``indirect`` selects.

        "detached" removes only the gradient of L_ind; V keeps its gradient to geometry.
        """
        hits = self.trace(tracer, points, direction, tracer.geometry.centre.new_zeros(len(tracer.geometry), 0))
        visibility, finished = visibility_of(hits)
        radiance = (hits.radiance * finished[:, None]).view(direction.shape)
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
        """Trace V, and L_ind as the split sum at the hits (``hit_surface``): the harmonics belong to another light."""
        hits = self.trace(tracer, points, direction, features)
        visibility, radiance = hit_radiance(hits, direction.flatten(0, 1), light)
        return Incident(direction, weight, visibility.view(weight.shape), radiance.view(direction.shape))


def shade_points(points: SeenPoints, incident: Incident, environment: Float[Tensor, "rows columns 3"]) -> Shaded:
    """Shade points under their incident light; zero where the camera is below the surface."""
    parts = shade_materials(
        points.normal, points.albedo, points.roughness, points.outgoing[:, None], incident, environment
    )[:, 0]
    return Shaded(
        parts[:, DIFFUSE_DIRECT] + parts[:, SPECULAR_DIRECT],
        parts[:, DIFFUSE_INDIRECT] + parts[:, SPECULAR_INDIRECT],
    )
