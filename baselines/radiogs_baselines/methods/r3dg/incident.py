"""Incident light of surfels: the environment times V, by a table traced once, plus each surfel's local light."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.kernels.surfel.harmonics import harmonic_sum
from radiogs_core.kernels.trace.trace import trace
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_core.transport.tracer import BACK_OFFSET, RAYS_AT_ONCE, SELF_OFFSET, SurfelTracer

from .settings import LocalLight, Variant


@dataclass(frozen=True)
class RaySettings:
    """How rays from surfels are traced; see the fields of ``Variant``."""

    start: float | None = None
    """Distance from the surfel at which rays start, world units; None: one standard deviation of the surfel."""
    two_sided: bool = True
    """Whether rays hit surfels from behind, too."""
    hidden_below: float = 0.9
    """Transmittance below which V is set to 0."""
    floor: bool = False
    """Whether no direction is below 10 degrees elevation."""

    @classmethod
    def of(cls, variant: Variant, extent: float) -> "RaySettings":
        """Ray settings of a variant; ``extent``: the scene's extent, world units."""
        start = None if variant.ray_start is None else variant.ray_start * extent
        return cls(start, variant.two_sided, variant.hidden_below, variant.floor)

    @torch.no_grad()
    def visibility(
        self, tracer: SurfelTracer, index: Int[Tensor, " chosen"], direction: Float[Tensor, "chosen samples 3"]
    ) -> Float[Tensor, "chosen samples"]:
        """V from the centres of the surfels ``index``: the transmittance T, or 0 if T < ``hidden_below``."""
        together = max(1, RAYS_AT_ONCE // direction.shape[1])
        pieces = zip(index.split(together), direction.split(together), strict=True)
        return torch.cat([self._traced(tracer, *piece) for piece in pieces])

    def _traced(self, tracer: SurfelTracer, index: Tensor, direction: Tensor) -> Tensor:
        surfels, samples = tracer.surfels, direction.shape[1]
        width = surfels.scale.amax(-1)[index].repeat_interleave(samples)
        start = SELF_OFFSET * width if self.start is None else torch.full_like(width, self.start)
        transmittance = trace(
            tracer.bvh, tracer.geometry, surfels.sh[:, :1], surfels.sh.new_zeros(len(surfels), 0),
            surfels.centre[index].repeat_interleave(samples, 0), direction.flatten(0, 1), start,
            stop=self.hidden_below, back_from=BACK_OFFSET * width if self.two_sided else None,
        ).transmittance  # fmt: skip
        return torch.where(transmittance < self.hidden_below, 0.0, transmittance).view(direction.shape[:2])


class VisibilityTable:
    """Directions of every surfel, their solid angles in steradian, and V along them. No gradient.

    All surfels have the same hemisphere of directions, rotated to their normals.
    """

    def __init__(self, surfels: Surfels, rays: RaySettings, samples: int) -> None:
        everything = torch.arange(len(surfels), device=surfels.centre.device)
        self.rays, self.tracer = rays, SurfelTracer(surfels.take(everything))
        self.normal = self.tracer.surfels.frame[..., 2]
        self.direction, self.weight = hemisphere_directions(self.normal, samples, None, rays.floor)
        self.visibility = rays.visibility(self.tracer, everything, self.direction)

    def retrace(self, index: Int[Tensor, " chosen"], generator: torch.Generator) -> None:
        """Rotate the directions of some surfels about their normals at random and trace V again."""
        direction, _ = hemisphere_directions(self.normal[index], self.weight.shape[1], generator, self.rays.floor)
        self.direction[index] = direction
        self.visibility[index] = self.rays.visibility(self.tracer, index, direction)

    def state(self) -> dict[str, Any]:
        """The tensors that ``retrace`` changes."""
        return {"direction": self.direction.clone(), "visibility": self.visibility.clone()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        self.direction, self.visibility = state["direction"].clone(), state["visibility"].clone()


def local_radiance(
    harmonics: Float[Tensor, "surfels 16 3"], direction: Float[Tensor, "surfels samples 3"]
) -> Float[Tensor, "surfels samples 3"]:
    """max(0, sum_lm h_lm Y_lm(w)): linear radiance from unit ``direction``, in the basis and signs of 3DGS.

    Where the sum is exactly zero, as at the start, the gradient passes.
    """
    return harmonic_sum(harmonics, direction).clamp(min=0)


def arriving(table: VisibilityTable, harmonics: Float[Tensor, "surfels 16 3"], local: LocalLight) -> Incident:
    """Incident light with V from the table and local light as its indirect radiance; gradient to ``harmonics``."""
    if local == "none":
        return Incident(table.direction, table.weight, table.visibility, torch.zeros_like(table.direction))
    radiance = local_radiance(harmonics, table.direction)
    if local == "gated":
        radiance = radiance * (1 - table.visibility[..., None])
    return Incident(table.direction, table.weight, table.visibility, radiance)
