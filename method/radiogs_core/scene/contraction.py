"""The contraction of unbounded space into a ball: near the cameras as it is, far away by disparity (mip-NeRF 360)."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from .scene import Scene


@dataclass(frozen=True)
class Contraction:
    """Space around ``centre``, contracted outside the ball of ``radius`` (both in world units).

    With x = (p - centre) / radius, a point stays at x inside the ball, and lies at (2 - 1 / |x|) x / |x| outside: all
    of space in a ball of radius 2, in which distance from the unit ball outwards is disparity (Barron et al. 2022,
    Eq. 10).
    """

    centre: Float[Tensor, "3"]
    radius: float

    @classmethod
    def of(cls, scene: Scene) -> "Contraction":
        """The ball around the scene's centre that holds all training cameras."""
        origins = torch.stack([view.camera.centre for view in scene.train]).double()
        return cls(scene.centre, float((origins - scene.centre).norm(dim=-1).max()))

    def contracted(self, points: Float[Tensor, "points 3"]) -> Float[Tensor, "points 3"]:
        """World points in the ball of radius 2."""
        place = (points - self.centre.to(points)) / self.radius
        distance = place.norm(dim=-1, keepdim=True).clamp(min=1)
        return place * (2 - 1 / distance) / distance

    def stretch(self, points: Float[Tensor, "points 3"]) -> Float[Tensor, " points"]:
        """How many times larger things may be at world points than inside the ball, to look as large: max(1, |x|)."""
        return ((points - self.centre.to(points)).norm(dim=-1) / self.radius).clamp(min=1)
