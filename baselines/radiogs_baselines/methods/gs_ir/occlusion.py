"""Baked ambient occlusion: the open share of the sphere at lattice corners near surfaces, for occluders within tau.

Occluders at a distance of tau or more do not count, so O is not the visibility of the light; shading weights L_env by O
and L_ind by 1 - O. No gradient.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.kernels.surfel.harmonics import harmonic_sum
from radiogs_core.surfels.harmonics import COEFFICIENTS
from radiogs_core.surfels.restoring import finite_tensor
from radiogs_core.transport.sampling import GOLDEN_ANGLE, tangent_frame
from radiogs_core.transport.tracer import RAYS_AT_ONCE

from .lattice import Lattice, broken_volume

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


def sphere_directions(count: int, **like: Any) -> Float[Tensor, "count 3"]:
    """Spherical Fibonacci set of unit directions; each represents a solid angle of 4 pi / count steradian."""
    step = torch.arange(count, dtype=torch.float64)
    height, azimuth = 1 - (2 * step + 1) / count, step * GOLDEN_ANGLE
    sine = (1 - height.square()).sqrt()
    return torch.stack([sine * azimuth.cos(), sine * azimuth.sin(), height], -1).to(**like)


def projection(direction: Float[Tensor, "count 3"]) -> Float[Tensor, "count 16"]:
    """Matrix Y(w) 4 pi / count, which projects values [..., count] onto harmonics of degrees 0 to 3."""
    of_each = _of_three_channels(torch.eye(COEFFICIENTS).to(direction))
    basis = harmonic_sum(of_each, direction.expand(COEFFICIENTS, -1, 3))[..., 0].T
    return basis * (4 * torch.pi / len(direction))


def _of_three_channels(coefficients: Float[Tensor, "points count"]) -> Float[Tensor, "points count 3"]:
    return coefficients[..., None].expand(-1, -1, 3)
