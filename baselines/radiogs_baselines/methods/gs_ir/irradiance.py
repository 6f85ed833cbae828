"""The volume of indirect irradiance: grey harmonics on a lattice, learnt from the images and initialised to zero."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from jaxtyping import Float
from torch import Tensor

from radiogs_core.kernels.surfel.harmonics import harmonic_sum
from radiogs_core.surfels.restoring import finite_tensor

from .lattice import Lattice, broken_volume

COEFFICIENTS = 9
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
        return cls(lattice, lattice.low.new_zeros(lattice.corners**3, COEFFICIENTS))

    def at(self, position: Float[Tensor, "points 3"], normal: Float[Tensor, "points 3"]) -> Float[Tensor, " points"]:
        """I = max(0, sum of g Y(n)): grey irradiance over pi at world positions with unit normals, linear.

        Gradient to the harmonics only. Where the sum is exactly zero, as at the start, the gradient passes.
        """
        index, share = self.lattice.around(position.detach())
        around = self.coefficients.index_select(0, index.flatten()).view(*index.shape, COEFFICIENTS)
        of_three_channels = (share[..., None] * around).sum(1)[..., None].expand(-1, -1, 3)
        return harmonic_sum(of_three_channels, normal.detach()[:, None])[:, 0, 0].clamp(min=0)

    def tensors(self) -> dict[str, Any]:
        """The lattice and the harmonics as plain values, without gradient history."""
        return {**self.lattice.tensors(), "coefficients": self.coefficients.detach()}

    @classmethod
    def of(cls, tensors: Mapping[str, Any]) -> "IrradianceVolume":
        """The inverse of ``tensors``. Raises DataError for tensors of wrong shape or with non-finite values."""
        lattice, coefficients = Lattice.of_tensors(tensors), finite_tensor(tensors, "coefficients")
        if coefficients.shape != (lattice.corners**3, COEFFICIENTS):
            raise broken_volume(f"has harmonics of the shape {tuple(coefficients.shape)}, {lattice.corners}^3 corners")
        return cls(lattice, coefficients)
