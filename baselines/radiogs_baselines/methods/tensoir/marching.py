"""Rays marched through the field: where samples lie, how much each counts, and what they add up to."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from .field import Field

STEP = 0.5
"""Distance of samples, in spacings of the grid."""

COUNTS = 1e-4
"""Weight above which the networks are asked about a sample."""


@dataclass(frozen=True)
class Rays:
    """Rays in a box's local coordinates; ``direction`` is of unit length and points away from who looks."""

    origin: Float[Tensor, "rays 3"]
    direction: Float[Tensor, "rays 3"]

    def __len__(self) -> int:
        return len(self.origin)


@dataclass(frozen=True)
class Samples:
    """Samples of rays in occupied cells, in order along each ray.

    ray, slot: which ray, and which of its ``slots`` places. distance: along it, local. place: local.
    """

    rays: int
    slots: int
    ray: Int[Tensor, " samples"]
    slot: Int[Tensor, " samples"]
    distance: Float[Tensor, " samples"]
    place: Float[Tensor, "samples 3"]


@dataclass(frozen=True)
class Marched:
    """The samples of rays with their weights T_k alpha_k.

    ``weight``: of every sample. ``counted``: those that the networks are asked about; the others add nothing to maps.
    alpha: sum of all weights. distance: mean of the samples', local, 0 for a ray that meets nothing.
    """

    samples: Samples
    weight: Float[Tensor, " samples"]
    counted: Int[Tensor, " counted"]

    @property
    def alpha(self) -> Float[Tensor, " rays"]:
        """Coverage of each ray."""
        return self._total(self.weight, self.samples.ray)

    @property
    def distance(self) -> Float[Tensor, " rays"]:
        """Where each ray ends, on average."""
        alpha = self.alpha
        total = self._total(self.weight * self.samples.distance, self.samples.ray)
        return total / torch.where(alpha > 0, alpha, 1.0)

    @property
    def places(self) -> Float[Tensor, "counted 3"]:
        """Local places of the counted samples."""
        return self.samples.place[self.counted]

    @property
    def ray(self) -> Int[Tensor, " counted"]:
        """The rays that the counted samples are of."""
        return self.samples.ray[self.counted]

    def blended(self, values: Float[Tensor, "counted ..."]) -> Float[Tensor, "rays ..."]:
        """Sums over the counted samples of weight times value, by ray."""
        weight = self.weight[self.counted]
        return self._total(weight.view(-1, *[1] * (values.dim() - 1)) * values, self.ray)

    def _total(self, values: Tensor, ray: Tensor) -> Tensor:
        return values.new_zeros(self.samples.rays, *values.shape[1:]).index_add(0, ray, values)


def primary_samples(field: Field, rays: Rays, generator: torch.Generator | None) -> Samples:
    """Every half spacing of the grid from where a ray enters the cube (or begins) to where it leaves.

    They are displaced along each ray by a random share of the step; without ``generator`` by half of it.
    """
    step = STEP * field.spacing
    # A direction's zero component gives infinities of the right sign; 0 / 0 on a face counts as inside.
    low, high = ((side - rays.origin) / rays.direction for side in (-1, 1))
    on_face = low.isnan() | high.isnan()
    enter = torch.where(on_face, -torch.inf, torch.minimum(low, high))
    leave = torch.where(on_face, torch.inf, torch.maximum(low, high))
    begin, end = enter.amax(-1).clamp(min=0), leave.amin(-1)
    slots = max(1, int((end - begin).clamp(min=0).max() / step) + 1) if len(rays) else 1
    shift = begin.new_full((len(rays), 1), 0.5)
    if generator is not None:
        shift = torch.rand(len(rays), 1, generator=generator, dtype=begin.dtype, device=begin.device)
    distance = begin[:, None] + step * (torch.arange(slots, dtype=begin.dtype, device=begin.device) + shift)
    return kept_samples(field, rays, distance, distance < end[:, None])


def kept_samples(field: Field, rays: Rays, distance: Float[Tensor, "rays slots"], wanted: Tensor) -> Samples:
    """Those of the wanted samples [rays, slots] that lie in occupied cells."""
    ray, slot = torch.nonzero(wanted, as_tuple=True)
    place = rays.origin[ray] + distance[ray, slot, None] * rays.direction[ray]
    held = torch.nonzero(field.box.holds(place))[:, 0]
    ray, slot = ray[held], slot[held]
    return Samples(len(rays), distance.shape[1], ray, slot, distance[ray, slot], place[held])


def optical_depth(samples: Samples, thickness: Float[Tensor, " samples"]) -> Float[Tensor, "rays slots"]:
    """Density times length at each slot, zero where no sample is kept."""
    flat = thickness.new_zeros(samples.rays * samples.slots)
    return flat.index_copy(0, samples.ray * samples.slots + samples.slot, thickness).view(samples.rays, samples.slots)


def weights_of(samples: Samples, density: Float[Tensor, " samples"], step: float) -> Float[Tensor, " samples"]:
    """T_k alpha_k: transmittance up to a sample times the opacity of the step that it stands for."""
    thickness = density * step
    dense = optical_depth(samples, thickness)
    before = (dense.cumsum(-1) - dense).flatten()[samples.ray * samples.slots + samples.slot]
    return torch.exp(-before) * -torch.expm1(-thickness)


def march(field: Field, rays: Rays, generator: torch.Generator | None = None) -> Marched:
    """Rays from cameras through the field."""
    samples = primary_samples(field, rays, generator)
    weight = weights_of(samples, field.density(samples.place), STEP * field.spacing)
    return Marched(samples, weight, torch.nonzero(weight.detach() > COUNTS)[:, 0])
