"""A lattice of corners over a cube, and trilinear shares of the eight around a place."""

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
"""Share of the surfels that may lie beyond either end of each axis: a single one far away makes every cell larger."""

EIGHT = ((0, 0, 0), (0, 0, 1), (0, 1, 0), (0, 1, 1), (1, 0, 0), (1, 0, 1), (1, 1, 0), (1, 1, 1))
"""The corners of a cell by their steps along x, y and z."""


@dataclass(frozen=True)
class Lattice:
    """``corners`` corners along each edge of a cube. Corner (i, j, k) has the number (i corners + j) corners + k.

    low: the cube's lowest corner, world. edge: length of the cube's edge, world units.
    """

    low: Float[Tensor, "3"]
    edge: float
    corners: int

    @classmethod
    def over(cls, surfels: Surfels, corners: int) -> "Lattice":
        """Over the smallest cube around the surfels' centres, but for strays, and a cell more on every side.

        The cube is at least as large as half of the surfels' standard deviations. There have to be a surfel and four
        corners an edge.
        """
        ordered = surfels.centre.detach().sort(0).values
        last = len(ordered) - 1
        low, high = ordered[int(STRAYS * last)], ordered[last - int(STRAYS * last)]
        widest = max(float((high - low).max()), float(surfels.scale.detach().median()))
        edge = widest * (corners - 1) / (corners - 3)  # two of the cells lie outside
        return cls((low + high) / 2 - edge / 2, edge, corners)

    @property
    def spacing(self) -> float:
        """Distance of neighbouring corners, world units."""
        return self.edge / (self.corners - 1)

    @property
    def half(self) -> float:
        """How far in front of a surface it is read, world units: nearly half a cell, as published."""
        return self.edge / (2 * self.corners)

    def of(self, corners: int) -> "Lattice":
        """Another number of corners over the same cube."""
        return replace(self, corners=corners)

    def inside(self, place: Float[Tensor, "places 3"]) -> Float[Tensor, "places 3"]:
        """The nearest place in the cube."""
        return torch.minimum(torch.maximum(place, self.low), self.low + self.edge)

    def around(self, place: Float[Tensor, "places 3"]) -> tuple[Int[Tensor, "places 8"], Float[Tensor, "places 8"]]:
        """Numbers of the corners of the cell that each place lies in, and its trilinear shares, which sum to one.

        A place outside the cube counts as the nearest one inside.
        """
        local = ((place - self.low) / self.spacing).clamp(0, self.corners - 1)
        first = local.detach().floor().clamp(max=self.corners - 2)
        beyond = (local - first)[:, None]
        step = torch.tensor(EIGHT, device=place.device)
        share = torch.where(step > 0, beyond, 1 - beyond).prod(-1)
        i, j, k = (first.long()[:, None] + step).unbind(-1)
        return (i * self.corners + j) * self.corners + k, share

    def places(self, number: Int[Tensor, "*shape"]) -> Float[Tensor, "*shape 3"]:
        """Where corners are, world."""
        column = number % self.corners
        row = number // self.corners % self.corners
        layer = number // self.corners**2
        return self.low + self.spacing * torch.stack([layer, row, column], -1).to(self.low)

    def tensors(self) -> dict[str, Any]:
        """The lattice as plain values."""
        return {"low": self.low, "edge": self.edge, "corners": self.corners}

    @classmethod
    def of_tensors(cls, tensors: Mapping[str, Any]) -> "Lattice":
        """The inverse of ``tensors``. Raises DataError for what is misshapen or not finite."""
        low, edge, corners = finite_tensor(tensors, "low"), tensors.get("edge"), tensors.get("corners")
        if low.shape != (3,) or not isinstance(edge, float) or not edge > 0:
            raise broken_volume("has no cube")
        if not isinstance(corners, int) or corners < 2:
            raise broken_volume(f"has {corners} corners along an edge")
        return cls(low, edge, corners)


def broken_volume(what: str) -> DataError:
    """The error for a stored volume; ``what`` goes on from "A volume of the stored model"."""
    return DataError(
        f"a volume of the stored model {what}",
        "It was written by another program, or is damaged.",
        "Train the model again, or put its file back.",
    )
