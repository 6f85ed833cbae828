"""The contraction of unbounded space into a ball (mip-NeRF 360): near the cameras the identity, far away disparity."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from .scene import Scene


@dataclass(frozen=True)
class Contraction:
    """A contraction of space outside a ball (Barron et al. 2022, Eq. 10).

    With x = (p - centre) / radius, a point inside the ball maps to x, and one outside to (2 - 1 / |x|) x / |x|. All of
    space maps into a ball of radius 2; outside the unit ball, distance from it measures disparity.
    """

    centre: Float[Tensor, "3"]
    """Centre of the ball, world units."""
    radius: float
    """Radius of the ball, world units."""

    @classmethod
    def of(cls, scene: Scene) -> "Contraction":
        """The ball around the scene's centre that holds all training cameras."""
        origins = torch.stack([view.camera.centre for view in scene.train]).double()
        return cls(scene.centre, float((origins - scene.centre).norm(dim=-1).max()))

    def contracted(self, points: Float[Tensor, "points 3"]) -> Float[Tensor, "points 3"]:
        """The contracted positions of world points, inside the ball of radius 2."""
        relative = (points - self.centre.to(points)) / self.radius
        distance = relative.norm(dim=-1, keepdim=True).clamp(min=1)
        return relative * (2 - 1 / distance) / distance

    def stretch(self, points: Float[Tensor, "points 3"]) -> Float[Tensor, " points"]:
        """max(1, |x|) at world points: the factor by which a thing there is larger than one inside the ball that looks
        as large."""
        return ((points - self.centre.to(points)).norm(dim=-1) / self.radius).clamp(min=1)
