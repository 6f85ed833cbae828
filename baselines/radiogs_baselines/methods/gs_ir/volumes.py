"""Volumes on a cubic lattice of corners: baked occlusion, and learnt irradiance.

Occlusion is the open share of the sphere at corners near surfaces, for occluders within tau. Occluders at a distance of
tau or more do not count, so O is not the visibility of the light; shading weights L_env by O and L_ind by 1 - O. It has
no gradient. Irradiance is grey, and learnt from the images; it starts at zero.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.errors import DataError
from radiogs_core.kernels.surfel.harmonics import harmonic_sum
from radiogs_core.surfels.harmonics import COEFFICIENTS
from radiogs_core.surfels.stored_tensors import finite_tensor
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.sampling import GOLDEN_ANGLE, tangent_frame
from radiogs_core.transport.tracer import RAYS_AT_ONCE

STRAYS = 0.001
"""Share of the surfels that may lie outside the lattice at each end of each axis: outliers would enlarge every cell."""

EIGHT = ((0, 0, 0), (0, 0, 1), (0, 1, 0), (0, 1, 1), (1, 0, 0), (1, 0, 1), (1, 1, 0), (1, 1, 1))
"""Offsets of a cell's corners from its first one, in steps along x, y and z."""


@dataclass(frozen=True)
class Lattice:
    """Corners on a regular grid over a cube. Corner (i, j, k) has the index (i corners + j) corners + k."""

    low: Float[Tensor, "3"]
    """The cube's corner of least x, y and z, world."""
    edge: float
    """Length of the cube's edge, world units."""
    corners: int
    """Number of corners along each edge."""

    @classmethod
    def over(cls, surfels: Surfels, corners: int) -> "Lattice":
        """Lattice over the smallest cube around the surfels' centres without outliers, with one more cell on each side.

        The inner cube's edge is at least the median of the surfels' standard deviations. Needs at least one surfel and
        four corners along an edge.
        """
        ordered = surfels.centre.detach().sort(0).values
        last = len(ordered) - 1
        low, high = ordered[int(STRAYS * last)], ordered[last - int(STRAYS * last)]
        widest = max(float((high - low).max()), float(surfels.scale.detach().median()))
        edge = widest * (corners - 1) / (corners - 3)  # two cells lie outside the inner cube
        return cls((low + high) / 2 - edge / 2, edge, corners)

    @property
    def spacing(self) -> float:
        """Distance of neighbouring corners, world units."""
        return self.edge / (self.corners - 1)

    @property
    def half(self) -> float:
        """Distance in front of a surface at which volumes are read, world units: nearly half a cell, as published."""
        return self.edge / (2 * self.corners)

    def of(self, corners: int) -> "Lattice":
        """Lattice over the same cube with another number of corners."""
        return replace(self, corners=corners)

    def inside(self, position: Float[Tensor, "positions 3"]) -> Float[Tensor, "positions 3"]:
        """Positions clamped to the cube."""
        return torch.minimum(torch.maximum(position, self.low), self.low + self.edge)

    def around(
        self, position: Float[Tensor, "positions 3"]
    ) -> tuple[Int[Tensor, "positions 8"], Float[Tensor, "positions 8"]]:
        """Indices of the eight corners around each position, clamped to the cube, and trilinear weights of sum one."""
        local = ((position - self.low) / self.spacing).clamp(0, self.corners - 1)
        first = local.detach().floor().clamp(max=self.corners - 2)
        beyond = (local - first)[:, None]
        step = torch.tensor(EIGHT, device=position.device)
        share = torch.where(step > 0, beyond, 1 - beyond).prod(-1)
        i, j, k = (first.long()[:, None] + step).unbind(-1)
        return (i * self.corners + j) * self.corners + k, share

    def positions(self, index: Int[Tensor, "*shape"]) -> Float[Tensor, "*shape 3"]:
        """World positions of the corners with these indices."""
        column = index % self.corners
        row = index // self.corners % self.corners
        layer = index // self.corners**2
        return self.low + self.spacing * torch.stack([layer, row, column], -1).to(self.low)

    def tensors(self) -> dict[str, Any]:
        """The lattice as plain values, for ``of_tensors``."""
        return {"low": self.low, "edge": self.edge, "corners": self.corners}

    @classmethod
    def of_tensors(cls, tensors: Mapping[str, Any]) -> "Lattice":
        """The inverse of ``tensors``. Raises DataError for tensors of wrong shape or with non-finite values."""
        low, edge, corners = finite_tensor(tensors, "low"), tensors.get("edge"), tensors.get("corners")
        if low.shape != (3,) or not isinstance(edge, float) or not edge > 0:
            raise broken_volume("has no cube")
        if not isinstance(corners, int) or corners < 2:
            raise broken_volume(f"has {corners} corners along an edge")
        return cls(low, edge, corners)


def broken_volume(what: str) -> DataError:
    """The error for a damaged volume; ``what`` completes the sentence "a volume of the stored model ..."."""
    return DataError(
        f"a volume of the stored model {what}",
        "It was written by another program, or is damaged.",
        "Train the model again, or put its file back.",
    )


IN_PLANE = 1e-4
"""Tolerance, in spacings, for corners behind a tangent plane: at the cube's faces all corners may lie in that plane."""


@dataclass(frozen=True)
class OcclusionVolume:
    """Occlusion probes, and the probe that each corner of a lattice reads: its own or an inherited one."""

    lattice: Lattice
    """Positions of the corners."""
    probe: Int[Tensor, " corners"]
    """Index of the probe that each corner reads."""
    coefficients: Float[Tensor, "probes 16"]
    """Harmonics of each probe's openness M(w) by direction, degrees 0 to 3 in the basis and signs of 3DGS."""

    @torch.no_grad()
    def at(self, position: Float[Tensor, "points 3"], normal: Float[Tensor, "points 3"]) -> Float[Tensor, "points 16"]:
        """Harmonics of M, interpolated trilinearly half a cell in front of surface points (world space).

        Corners behind the tangent plane there have no weight; the weights of the others are normalised to sum to one.
        """
        middle = self.lattice.inside(self.lattice.inside(position) + self.lattice.half * normal)
        index, share = self.lattice.around(middle)
        ahead = ((self.lattice.positions(index) - middle[:, None]) * normal[:, None]).sum(-1)
        share = torch.where(ahead >= -IN_PLANE * self.lattice.spacing, share, 0.0)
        share = share / share.sum(-1, keepdim=True)
        return (share[..., None] * self.coefficients[self.probe[index]]).sum(1)

    @torch.no_grad()
    def openness(
        self, position: Float[Tensor, "points 3"], normal: Float[Tensor, "points 3"], samples: int
    ) -> Float[Tensor, " points"]:
        """O in [0, 1]: the mean of M, clamped to [0, 1], over ``samples`` cosine-distributed directions.

        O is 1 for an open hemisphere. Every point has the same directions in its tangent frame.
        """
        together = max(1, RAYS_AT_ONCE // samples)
        pieces = zip(position.split(together), normal.split(together), strict=True)
        return torch.cat([mean_openness(self.at(*piece), piece[1], samples) for piece in pieces])

    def tensors(self) -> dict[str, Any]:
        """The lattice and the probes as plain values."""
        return {**self.lattice.tensors(), "probe": self.probe, "coefficients": self.coefficients}

    @classmethod
    def of(cls, tensors: Mapping[str, Any]) -> "OcclusionVolume":
        """The inverse of ``tensors``. Raises DataError for tensors of wrong shape or with non-finite values."""
        lattice, coefficients = Lattice.of_tensors(tensors), finite_tensor(tensors, "coefficients")
        if coefficients.ndim != 2 or coefficients.shape[1] != COEFFICIENTS:
            raise broken_volume(f"has harmonics of the shape {tuple(coefficients.shape)}")
        probe = tensors.get("probe")
        if not isinstance(probe, Tensor) or probe.shape != (lattice.corners**3,) or probe.dtype != torch.int64:
            raise broken_volume(f"lacks the index of a probe for each of its {lattice.corners}^3 corners")
        if int(probe.min()) < 0 or int(probe.max()) >= len(coefficients):
            raise broken_volume(f"has corners whose probe is none of its {len(coefficients)} probes")
        return cls(lattice, probe, coefficients)


def mean_openness(
    coefficients: Float[Tensor, "points 16"], normal: Float[Tensor, "points 3"], samples: int
) -> Float[Tensor, " points"]:
    """Mean of clamp(sum of c Y(w), 0, 1) over ``samples`` cosine-distributed directions w about ``normal``."""
    open_share = harmonic_sum(_of_three_channels(coefficients), cosine_directions(normal, samples))[..., 0]
    return open_share.clamp(0, 1).mean(-1)


def cosine_directions(normal: Float[Tensor, "points 3"], samples: int) -> Float[Tensor, "points samples 3"]:
    """Spiral of unit directions about each normal with density cosine / pi: equal steps of the squared sine."""
    step = torch.arange(samples, dtype=normal.dtype, device=normal.device)
    square = (step + 0.5) / samples
    azimuth, sine = step * GOLDEN_ANGLE, square.sqrt()
    local = torch.stack([sine * azimuth.cos(), sine * azimuth.sin(), (1 - square).sqrt()], -1)
    return local @ tangent_frame(normal).mT


def projection(direction: Float[Tensor, "count 3"]) -> Float[Tensor, "count 16"]:
    """Matrix Y(w) 4 pi / count, which projects values [..., count] onto harmonics of degrees 0 to 3."""
    of_each = _of_three_channels(torch.eye(COEFFICIENTS).to(direction))
    basis = harmonic_sum(of_each, direction.expand(COEFFICIENTS, -1, 3))[..., 0].T
    return basis * (4 * torch.pi / len(direction))


def _of_three_channels(coefficients: Float[Tensor, "points count"]) -> Float[Tensor, "points count 3"]:
    return coefficients[..., None].expand(-1, -1, 3)


IRRADIANCE_COEFFICIENTS = 9
"""Coefficients of degrees 0 to 2."""


@dataclass(frozen=True)
class IrradianceVolume:
    """Spherical harmonics of the indirect irradiance I at every corner of a lattice."""

    lattice: Lattice
    """Positions of the corners."""
    coefficients: Float[Tensor, "corners 9"]
    """Harmonics of degrees 0 to 2, in the basis and signs of 3DGS."""

    @classmethod
    def dark(cls, lattice: Lattice) -> "IrradianceVolume":
        """A volume whose harmonics are all zero."""
        return cls(lattice, lattice.low.new_zeros(lattice.corners**3, IRRADIANCE_COEFFICIENTS))

    def at(self, position: Float[Tensor, "points 3"], normal: Float[Tensor, "points 3"]) -> Float[Tensor, " points"]:
        """I = max(0, sum of g Y(n)): grey irradiance over pi at world positions with unit normals, linear.

        Gradient to the harmonics only. Where the sum is exactly zero, as at the start, the gradient passes.
        """
        index, share = self.lattice.around(position.detach())
        around = self.coefficients.index_select(0, index.flatten()).view(*index.shape, IRRADIANCE_COEFFICIENTS)
        of_three_channels = (share[..., None] * around).sum(1)[..., None].expand(-1, -1, 3)
        return harmonic_sum(of_three_channels, normal.detach()[:, None])[:, 0, 0].clamp(min=0)

    def tensors(self) -> dict[str, Any]:
        """The lattice and the harmonics as plain values, without gradient history."""
        return {**self.lattice.tensors(), "coefficients": self.coefficients.detach()}

    @classmethod
    def of(cls, tensors: Mapping[str, Any]) -> "IrradianceVolume":
        """The inverse of ``tensors``. Raises DataError for tensors of wrong shape or with non-finite values."""
        lattice, coefficients = Lattice.of_tensors(tensors), finite_tensor(tensors, "coefficients")
        if coefficients.shape != (lattice.corners**3, IRRADIANCE_COEFFICIENTS):
            raise broken_volume(f"has harmonics of the shape {tuple(coefficients.shape)}, {lattice.corners}^3 corners")
        return cls(lattice, coefficients)
