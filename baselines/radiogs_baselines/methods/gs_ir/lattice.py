"""A cubic lattice of corners, and trilinear weights of the eight corners around a position."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.errors import DataError
from radiogs_core.surfels.restoring import finite_tensor
from radiogs_core.surfels.surfels import Surfels

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
        """Indices of the eight corners around each position, and their trilinear weights, which sum to one.

        Positions outside the cube are clamped to it.
        """
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
