"""The table of visibility: V of every surfel along fixed directions, traced once."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.kernels.trace.trace import trace
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_core.transport.tracer import BACK_OFFSET, RAYS_AT_ONCE, SELF_OFFSET, SurfelTracer

from .settings import Variant


@dataclass(frozen=True)
class Rays:
    """Where rays from a surfel start, what they meet, and when they count as stopped (see ``Variant``).

    start: world units; None: in the surfel's own standard deviation.
    """

    start: float | None = None
    two_sided: bool = True
    hidden_below: float = 0.9
    floor: bool = False

    @classmethod
    def of(cls, variant: Variant, extent: float) -> "Rays":
        """Those of a variant; ``extent``: the scene's, world units."""
        start = None if variant.ray_start is None else variant.ray_start * extent
        return cls(start, variant.two_sided, variant.hidden_below, variant.floor)

    @torch.no_grad()
    def visibility(
        self, tracer: SurfelTracer, index: Int[Tensor, " chosen"], direction: Float[Tensor, "chosen samples 3"]
    ) -> Float[Tensor, "chosen samples"]:
        """V from the centres of the surfels ``index``: the transmittance T, or 0 as soon as T < ``hidden_below``."""
        together = max(1, RAYS_AT_ONCE // direction.shape[1])
        pieces = zip(index.split(together), direction.split(together), strict=True)
        return torch.cat([self._traced(tracer, *piece) for piece in pieces])

    def _traced(self, tracer: SurfelTracer, index: Tensor, direction: Tensor) -> Tensor:
        surfels, samples = tracer.surfels, direction.shape[1]
        width = surfels.scale.amax(-1)[index].repeat_interleave(samples)
        start = SELF_OFFSET * width if self.start is None else torch.full_like(width, self.start)
        left = trace(
            tracer.bvh, tracer.geometry, surfels.sh[:, :1], surfels.sh.new_zeros(len(surfels), 0),
            surfels.centre[index].repeat_interleave(samples, 0), direction.flatten(0, 1), start,
            stop=self.hidden_below, back_from=BACK_OFFSET * width if self.two_sided else None,
        ).transmittance  # fmt: skip
        return torch.where(left < self.hidden_below, 0.0, left).view(direction.shape[:2])


class VisibilityTable:
    """Directions of every surfel, the solid angle in steradian that each stands for, and V along them.

    All surfels have the same directions, turned to their normals and spread over the hemisphere. No gradient.
    """

    def __init__(self, surfels: Surfels, rays: Rays, samples: int) -> None:
        everything = torch.arange(len(surfels), device=surfels.centre.device)
        self.rays, self.tracer = rays, SurfelTracer(surfels.take(everything))
        self.normal = self.tracer.surfels.frame[..., 2]
        self.direction, self.weight = hemisphere_directions(self.normal, samples, None, rays.floor)
        self.visibility = rays.visibility(self.tracer, everything, self.direction)

    def retrace(self, index: Int[Tensor, " chosen"], generator: torch.Generator) -> None:
        """Turn the directions of some surfels at random and trace them anew."""
        direction, _ = hemisphere_directions(self.normal[index], self.weight.shape[1], generator, self.rays.floor)
        self.direction[index] = direction
        self.visibility[index] = self.rays.visibility(self.tracer, index, direction)

    def state(self) -> dict[str, Any]:
        """What ``retrace`` changes."""
        return {"direction": self.direction.clone(), "visibility": self.visibility.clone()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        self.direction, self.visibility = state["direction"].clone(), state["visibility"].clone()
