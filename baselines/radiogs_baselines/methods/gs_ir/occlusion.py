"""Baked ambient occlusion: on a lattice near surfaces, what is open of the sphere when only near geometry hides.

Occluders at a distance of tau or more do not count: this is no visibility of the light, and L_env and L_ind share what
is left by O alone. No gradient.
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
"""Corners so many spacings behind a tangent plane count as in it: at the cube's faces there may be no others."""


@dataclass(frozen=True)
class OcclusionVolume:
    """Which probe each corner of a lattice reads, its own or an inherited one, and the probes' harmonics.

    coefficients: of the open share M(w) of each direction, degrees 0 to 3 in the basis and signs of 3DGS.
    """

    lattice: Lattice
    probe: Int[Tensor, " corners"]
    coefficients: Float[Tensor, "probes 16"]

    @torch.no_grad()
    def at(self, place: Float[Tensor, "points 3"], normal: Float[Tensor, "points 3"]) -> Float[Tensor, "points 16"]:
        """Harmonics of M at surface points, half a cell in front of them, trilinear.

        Corners behind the tangent plane there do not count; the shares of the others are scaled to sum to one.
        """
        middle = self.lattice.inside(self.lattice.inside(place) + self.lattice.half * normal)
        number, share = self.lattice.around(middle)
        ahead = ((self.lattice.places(number) - middle[:, None]) * normal[:, None]).sum(-1)
        share = torch.where(ahead >= -IN_PLANE * self.lattice.spacing, share, 0.0)
        share = share / share.sum(-1, keepdim=True)
        return (share[..., None] * self.coefficients[self.probe[number]]).sum(1)

    @torch.no_grad()
    def openness(
        self, place: Float[Tensor, "points 3"], normal: Float[Tensor, "points 3"], samples: int
    ) -> Float[Tensor, " points"]:
        """O in [0, 1]: the mean of M, held between 0 and 1, over ``samples`` directions about unit ``normal``.

        They are distributed as their cosine and the same at every point: 1 is an open hemisphere.
        """
        together = max(1, RAYS_AT_ONCE // samples)
        pieces = zip(place.split(together), normal.split(together), strict=True)
        return torch.cat([mean_openness(self.at(*piece), piece[1], samples) for piece in pieces])

    def tensors(self) -> dict[str, Any]:
        """The volume as plain values."""
        return {**self.lattice.tensors(), "probe": self.probe, "coefficients": self.coefficients}

    @classmethod
    def of(cls, tensors: Mapping[str, Any]) -> "OcclusionVolume":
        """The inverse of ``tensors``. Raises DataError for what is misshapen or not finite."""
        lattice, coefficients = Lattice.of_tensors(tensors), finite_tensor(tensors, "coefficients")
        if coefficients.ndim != 2 or coefficients.shape[1] != COEFFICIENTS:
            raise broken_volume(f"has harmonics of the shape {tuple(coefficients.shape)}")
        probe = tensors.get("probe")
        if not isinstance(probe, Tensor) or probe.shape != (lattice.corners**3,) or probe.dtype != torch.int64:
            raise broken_volume(f"does not say which of its probes {lattice.corners}^3 corners read")
        if int(probe.min()) < 0 or int(probe.max()) >= len(coefficients):
            raise broken_volume(f"has corners that read none of its {len(coefficients)} probes")
        return cls(lattice, probe, coefficients)


def mean_openness(
    coefficients: Float[Tensor, "points 16"], normal: Float[Tensor, "points 3"], samples: int
) -> Float[Tensor, " points"]:
    """Mean of clamp(sum of c Y(w), 0, 1) over ``samples`` directions w that are distributed as their cosine."""
    open_share = harmonic_sum(_of_three_channels(coefficients), cosine_directions(normal, samples))[..., 0]
    return open_share.clamp(0, 1).mean(-1)


def cosine_directions(normal: Float[Tensor, "points 3"], samples: int) -> Float[Tensor, "points samples 3"]:
    """A spiral about each unit normal whose density is cosine / pi: equal steps of the squared sine, not turned."""
    step = torch.arange(samples, dtype=normal.dtype, device=normal.device)
    square = (step + 0.5) / samples
    azimuth, sine = step * GOLDEN_ANGLE, square.sqrt()
    local = torch.stack([sine * azimuth.cos(), sine * azimuth.sin(), (1 - square).sqrt()], -1)
    return local @ tangent_frame(normal).mT


def sphere_directions(count: int, **like: Any) -> Float[Tensor, "count 3"]:
    """A spherical-Fibonacci set over the sphere; each direction stands for 4 pi / count."""
    step = torch.arange(count, dtype=torch.float64)
    height, azimuth = 1 - (2 * step + 1) / count, step * GOLDEN_ANGLE
    sine = (1 - height.square()).sqrt()
    return torch.stack([sine * azimuth.cos(), sine * azimuth.sin(), height], -1).to(**like)


def projection(direction: Float[Tensor, "count 3"]) -> Float[Tensor, "count 16"]:
    """Y(w) 4 pi / count: a row of values along the directions times this are its harmonics."""
    of_each = _of_three_channels(torch.eye(COEFFICIENTS).to(direction))
    basis = harmonic_sum(of_each, direction.expand(COEFFICIENTS, -1, 3))[..., 0].T
    return basis * (4 * torch.pi / len(direction))


def _of_three_channels(coefficients: Float[Tensor, "points count"]) -> Float[Tensor, "points count 3"]:
    return coefficients[..., None].expand(-1, -1, 3)
