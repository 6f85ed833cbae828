"""Samples of a scene's true surfaces: the ground truth for geometry and materials."""

from collections.abc import Callable
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class SurfaceSamples:
    """Points on surfaces, each the centre of a rectangular cell; the cells cover the sampled surfaces once."""

    centre: Float[Tensor, "samples 3"]
    """Positions in the world."""
    frame: Float[Tensor, "samples 3 3"]
    """Orthonormal frames in the world: columns t_u, t_v, n, with n outwards."""
    size: Float[Tensor, "samples 2"]
    """Sides of the cells along t_u and t_v, world units."""
    albedo: Float[Tensor, "samples 3"]
    """Diffuse albedo, linear."""
    roughness: Float[Tensor, " samples"]
    """Perceptual roughness r (alpha_GGX = r^2)."""
    emission: Float[Tensor, "samples 3"] | None = None
    """Emitted radiance, linear RGB, the same in all directions; None if no surface emits."""
    specular: bool = True
    """Whether the surfaces have a specular lobe beside the Lambertian one."""

    def __len__(self) -> int:
        return len(self.centre)


Surfaces = Callable[[float], SurfaceSamples]
"""Samples all surfaces of a scene at a spacing in world units; the samples are on the CPU, float64."""
