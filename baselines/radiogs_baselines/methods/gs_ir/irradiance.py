"""The volume of indirect irradiance: gray harmonics on a lattice, learnt from images alone and starting at zero."""

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
    """Harmonics of I at every corner of a lattice, in the basis and signs of 3DGS."""

    lattice: Lattice
    coefficients: Float[Tensor, "corners 9"]

    @classmethod
    def dark(cls, lattice: Lattice) -> "IrradianceVolume":
        """Zero everywhere."""
        return cls(lattice, lattice.low.new_zeros(lattice.corners**3, COEFFICIENTS))

    def at(self, place: Float[Tensor, "points 3"], normal: Float[Tensor, "points 3"]) -> Float[Tensor, " points"]:
        """I = max(0, sum of g Y(n)): gray irradiance over pi that arrives at unit ``normal``, linear.

        Gradient to the harmonics alone; at zero, where they start, it is that of what lies above.
        """
        number, share = self.lattice.around(place.detach())
        around = self.coefficients.index_select(0, number.flatten()).view(*number.shape, COEFFICIENTS)
        of_three_channels = (share[..., None] * around).sum(1)[..., None].expand(-1, -1, 3)
        return harmonic_sum(of_three_channels, normal.detach()[:, None])[:, 0, 0].clamp(min=0)

    def tensors(self) -> dict[str, Any]:
        """The volume as plain values, without gradient history."""
        return {**self.lattice.tensors(), "coefficients": self.coefficients.detach()}

    @classmethod
    def of(cls, tensors: Mapping[str, Any]) -> "IrradianceVolume":
        """The inverse of ``tensors``. Raises DataError for what is misshapen or not finite."""
        lattice, coefficients = Lattice.of_tensors(tensors), finite_tensor(tensors, "coefficients")
        if coefficients.shape != (lattice.corners**3, COEFFICIENTS):
            raise broken_volume(f"has harmonics of the shape {tuple(coefficients.shape)}, {lattice.corners}^3 corners")
        return cls(lattice, coefficients)
