"""Surfaces of a scene that are known exactly, as samples: ground truth for whatever a method places on them."""

from collections.abc import Callable
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class SurfaceSamples:
    """Points on surfaces, each standing for the rectangular cell around it; the cells cover what is sampled once.

    centre: world. frame: orthonormal, columns t_u, t_v, n, with n outwards. size: of the cell along t_u and t_v, world
    units. albedo: linear, diffuse. roughness: perceptual (alpha_GGX = r^2). emission: linear radiance that the surfaces
    send out by themselves, the same in all directions; None: none do. specular: whether they have a specular lobe
    besides Lambert's.
    """

    centre: Float[Tensor, "samples 3"]
    frame: Float[Tensor, "samples 3 3"]
    size: Float[Tensor, "samples 2"]
    albedo: Float[Tensor, "samples 3"]
    roughness: Float[Tensor, " samples"]
    emission: Float[Tensor, "samples 3"] | None = None
    specular: bool = True

    def __len__(self) -> int:
        return len(self.centre)


Surfaces = Callable[[float], SurfaceSamples]
"""Samples all surfaces of a scene, about so many world units apart; on the CPU, float64."""
