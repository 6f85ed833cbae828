"""Baking occlusion: rays from the corners of a lattice that surfels are near, once, before stage 2."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from radiogs_core.kernels.trace.trace import trace
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.tracer import RAYS_AT_ONCE, SurfelTracer

from .lattice import Lattice
from .occlusion import OcclusionVolume, projection, sphere_directions
from .variant import Variant

SOLID = 0.5
"""Opacity along a ray above which its depth is that of an occluder."""


@dataclass(frozen=True)
class Reach:
    """Which occluders a probe knows, by their distance in world units: from ``nearest`` on and nearer than ``tau``."""

    nearest: float = 0.0
    tau: float = torch.inf

    @classmethod
    def of(cls, variant: Variant, extent: float) -> "Reach":
        """That of a variant; ``extent``: the scene's, world units."""
        return cls(variant.nearest * extent, torch.inf if variant.tau is None else variant.tau * extent)

    def hidden(
        self, tracer: SurfelTracer, origin: Float[Tensor, "rays 3"], direction: Float[Tensor, "rays 3"]
    ) -> Bool[Tensor, " rays"]:
        """Whether each ray is more than half covered and the mean depth of what covers it is less than tau.

        Surfels are met from both sides: a probe may lie on either of them. The depth is that of the whole ray, divided
        by its opacity, as a rasterizer blends it.
        """
        surfels, start = tracer.surfels, torch.full_like(origin[:, 0], self.nearest)
        hits = trace(
            tracer.bvh, tracer.geometry, surfels.sh[:, :1], surfels.sh.new_zeros(len(surfels), 0),
            origin, direction, start, back_from=torch.zeros_like(start),
        )  # fmt: skip
        opacity = 1 - hits.transmittance
        depth = hits.depth / torch.where(opacity > 0, opacity, 1.0)
        return (opacity > SOLID) & (depth < self.tau)


@torch.no_grad()
def bake(surfels: Surfels, lattice: Lattice, reach: Reach, directions: int) -> OcclusionVolume:
    """The harmonics of M at every corner near a surfel; the other corners inherit the nearest probe, by grid steps.

    M(w) = 0 where ``Reach.hidden``, else 1, along ``directions`` directions that are spread over the sphere. There has
    to be at least one surfel.
    """
    near = corners_near(surfels, lattice)
    tracer = SurfelTracer(surfels).built()
    direction = sphere_directions(directions, dtype=lattice.low.dtype, device=lattice.low.device)
    onto = projection(direction)
    parts = []
    for some in lattice.places(near).split(max(1, RAYS_AT_ONCE // directions)):
        hidden = reach.hidden(tracer, some.repeat_interleave(directions, 0), direction.repeat(len(some), 1))
        parts.append((~hidden).to(onto).view(len(some), directions) @ onto)
    return OcclusionVolume(lattice, inherited(near, lattice.corners), torch.cat(parts))


def corners_near(surfels: Surfels, lattice: Lattice) -> Int[Tensor, " near"]:
    """Numbers, in order, of the corners of the cells that a surfel touches or is read in.

    That is at its centre and one standard deviation along each of its axes, and half a cell in front of these places.
    """
    along = (
        surfels.frame.detach() * torch.nn.functional.pad(surfels.scale.detach(), (0, 1), value=lattice.half)[:, None]
    )
    tangent_u, tangent_v, ahead = along.unbind(-1)
    on = [surfels.centre.detach() + offset for offset in (0 * ahead, tangent_u, -tangent_u, tangent_v, -tangent_v)]
    number, _ = lattice.around(torch.cat([*on, *(place + ahead for place in on)]))
    return torch.unique(number)


def inherited(near: Int[Tensor, " near"], corners: int) -> Int[Tensor, " corners"]:
    """The probe that each corner reads: its own place in ``near``, or that of a neighbour which has one by now.

    In rounds, by the six neighbours, so that a corner inherits from one of those that are fewest steps away.
    """
    probe = torch.full((corners,) * 3, -1, dtype=torch.int64, device=near.device)
    probe.view(-1)[near] = torch.arange(len(near), device=near.device)
    while bool((probe < 0).any()):
        before = probe.clone()
        for axis in range(3):
            _inherit(probe.narrow(axis, 0, corners - 1), before.narrow(axis, 1, corners - 1))
            _inherit(probe.narrow(axis, 1, corners - 1), before.narrow(axis, 0, corners - 1))
    return probe.flatten()


def _inherit(own: Tensor, neighbour: Tensor) -> None:
    own.copy_(torch.where(own < 0, neighbour, own))
