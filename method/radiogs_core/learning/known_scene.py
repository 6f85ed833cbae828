"""A generated scene as surfels: its exact geometry and materials, and the rendering equation on them."""

from dataclasses import dataclass, replace

import torch

from ..errors import DataError
from ..scene.light import EnvironmentMap
from ..scene.scene import Scene
from ..surfels.known_surfaces import surfels_on
from ..surfels.surfels import Surfels
from ..transport.splatting import DIFFUSE_DIRECT, DIFFUSE_INDIRECT
from .radiance_solver import RenderingEquation

OFFSET = 0.1
"""Distance from its surfel at which a ray starts, in standard deviations: surfels that lie exactly on a surface need
little more than the rounding error."""


@dataclass(frozen=True)
class KnownScene:
    """Surfels on the true surfaces with the true materials, before their radiance is solved for; float32."""

    surfels: Surfels
    """The surfels; until it is solved for, their radiance is 1/2."""
    equation: RenderingEquation
    """Light, albedo and emission, which determine the surfels' radiance."""

    def to(self, device: torch.device) -> "KnownScene":
        """A copy on another device."""
        surfels = Surfels.of({name: value.to(device) for name, value in self.surfels.parameters().items()})
        emission = self.equation.emission
        return KnownScene(
            surfels,
            replace(
                self.equation,
                light=EnvironmentMap(self.equation.light.radiance.to(device)),
                albedo=self.equation.albedo.to(device),
                emission=None if emission is None else emission.to(device),
            ),
        )


def known_scene(scene: Scene, spacing: float) -> KnownScene:
    """Surfels about ``spacing`` world units apart on the true surfaces of a scene, under its true light.

    Raises DataError if the surfaces or the light are not known.
    """
    if scene.training_light is None:
        raise DataError(
            f"the light of scene '{scene.name}' is not known",
            "The radiance of surfels is solved for under the true light.",
            "Use a generated scene, which knows its light.",
        )
    samples = scene.true_surfaces(spacing)
    surfels = surfels_on(samples)
    equation = RenderingEquation(scene.training_light, surfels.albedo)
    if samples.emission is not None:
        equation = replace(equation, emission=samples.emission.float())
    if not samples.specular:
        equation = replace(equation, parts=(DIFFUSE_DIRECT, DIFFUSE_INDIRECT))
    return KnownScene(surfels, equation)
