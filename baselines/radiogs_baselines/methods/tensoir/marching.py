"""Ray marching through the field: positions of samples, their weights, and blended sums."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from .field import Field

STEP = 0.5
"""Distance between samples, in spacings of the grid."""

COUNTED_WEIGHT = 1e-4
"""Weight above which the networks are evaluated at a sample."""


@dataclass(frozen=True)
class Rays:
    """Rays in a box's local coordinates."""

    origin: Float[Tensor, "rays 3"]
    """Positions of the origins."""
    direction: Float[Tensor, "rays 3"]
    """Unit directions, away from the viewer."""

    def __len__(self) -> int:
        return len(self.origin)


@dataclass(frozen=True)
class Samples:
    """Samples of rays in occupied cells, in order along each ray."""

    rays: int
    """Number of rays."""
    slots: int
    """Number of marching steps of each ray, with or without a sample."""
    ray: Int[Tensor, " samples"]
    """Index of each sample's ray."""
    slot: Int[Tensor, " samples"]
    """Index of each sample's marching step."""
    distance: Float[Tensor, " samples"]
    """Distance from the ray's origin, local length."""
    position: Float[Tensor, "samples 3"]
    """Local positions."""


@dataclass(frozen=True)
class Marched:
    """The samples of rays with their weights."""

    samples: Samples
    """All samples in occupied cells."""
    weight: Float[Tensor, " samples"]
    """Blending weights T_k alpha_k."""
    counted: Int[Tensor, " counted"]
    """Indices of the samples at which networks are evaluated; only these contribute to blended values."""

    @property
    def alpha(self) -> Float[Tensor, " rays"]:
        """Coverage of each ray: the sum of its weights."""
        return self._total(self.weight, self.samples.ray)

    @property
    def distance(self) -> Float[Tensor, " rays"]:
        """Weighted mean distance of each ray's samples, local length; 0 for a ray without density."""
        alpha = self.alpha
        total = self._total(self.weight * self.samples.distance, self.samples.ray)
        return total / torch.where(alpha > 0, alpha, 1.0)

    @property
    def positions(self) -> Float[Tensor, "counted 3"]:
        """Local positions of the counted samples."""
        return self.samples.position[self.counted]

    @property
    def ray(self) -> Int[Tensor, " counted"]:
        """Indices of the counted samples' rays."""
        return self.samples.ray[self.counted]

    def blended(self, values: Float[Tensor, "counted ..."]) -> Float[Tensor, "rays ..."]:
        """Sum of weight times value over each ray's counted samples."""
        weight = self.weight[self.counted]
        return self._total(weight.view(-1, *[1] * (values.dim() - 1)) * values, self.ray)

    def _total(self, values: Tensor, ray: Tensor) -> Tensor:
        return values.new_zeros(self.samples.rays, *values.shape[1:]).index_add(0, ray, values)


def primary_samples(field: Field, rays: Rays, generator: torch.Generator | None) -> Samples:
    """Samples at every half grid spacing, from the ray's entry into the cube (or its origin) to its exit.

    Each ray's samples are displaced by a random share of the step; without ``generator`` by half of it.
    """
    step = STEP * field.spacing
    # A zero component of the direction gives infinities of the right sign; 0 / 0 (on a face) counts as inside.
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


def kept_samples(field: Field, rays: Rays, distance: Float[Tensor, "rays slots"], valid: Tensor) -> Samples:
    """The samples with ``valid`` [rays, slots] that lie in occupied cells."""
    ray, slot = torch.nonzero(valid, as_tuple=True)
    position = rays.origin[ray] + distance[ray, slot, None] * rays.direction[ray]
    kept = torch.nonzero(field.box.holds(position))[:, 0]
    ray, slot = ray[kept], slot[kept]
    return Samples(len(rays), distance.shape[1], ray, slot, distance[ray, slot], position[kept])


def optical_depth(samples: Samples, thickness: Float[Tensor, " samples"]) -> Float[Tensor, "rays slots"]:
    """Scatter the samples' optical thickness into [rays, slots]; zero without a sample."""
    flat = thickness.new_zeros(samples.rays * samples.slots)
    return flat.index_copy(0, samples.ray * samples.slots + samples.slot, thickness).view(samples.rays, samples.slots)


def weights_of(samples: Samples, density: Float[Tensor, " samples"], step: float) -> Float[Tensor, " samples"]:
    """Blending weights T_k alpha_k: transmittance before a sample times the opacity of its step (local length)."""
    thickness = density * step
    dense = optical_depth(samples, thickness)
    before = (dense.cumsum(-1) - dense).flatten()[samples.ray * samples.slots + samples.slot]
    return torch.exp(-before) * -torch.expm1(-thickness)


def march(field: Field, rays: Rays, generator: torch.Generator | None = None) -> Marched:
    """March camera rays through the field; without ``generator`` samples lie in the middle of their steps."""
    samples = primary_samples(field, rays, generator)
    weight = weights_of(samples, field.density(samples.position), STEP * field.spacing)
    return Marched(samples, weight, torch.nonzero(weight.detach() > COUNTED_WEIGHT)[:, 0])
