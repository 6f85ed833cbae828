"""A trained model as it is shown: shaded as it was trained, under the light it was trained in."""

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.camera import Camera
from radiogs_core.transport.splatting import incident_map, shaded_maps, split_sum_maps
from radiogs_core.transport.tracer import gather_incident

from .model import Model
from .tracing import Rays
from .variant import Variant


class Renderer:
    """A trained model under the light it was trained in, ready to be seen from any camera, shaded as it was trained.

    For Monte-Carlo shading, incident light is traced once, from ``samples`` fixed directions per surfel; what the
    model's plan left out stays out. Surfels that kept their light in training are traced with all others. Indirect
    light that was given in training is given here too.
    """

    def __init__(self, model: Model, samples: int, variant: Variant) -> None:
        self.model, self.incident, self.straight = model, None, variant.straight
        if variant.shading == "monte-carlo":
            with torch.no_grad():
                rays, surfels = Rays.of(variant, model.indirect), model.surfels
                self.incident = gather_incident(
                    rays.tracer(surfels), surfels, samples, None, rays.floor, model.plan.at_once
                )

    def incident_map(self, camera: Camera) -> Float[Tensor, "height width 3"]:
        """The indirect radiance that arrives (see ``splatting.incident_map``); not for split-sum shading."""
        assert self.incident is not None
        return incident_map(camera, self.model.surfels, self.incident)

    def render(self, camera: Camera) -> dict[str, Float[Tensor, "height width _"]]:
        """Maps of one view, [height, width, channels], all composited on black.

        image: display sRGB, clipped to [0, 1]. direct, indirect: linear outgoing radiance. albedo: linear.
        roughness, alpha, depth (world z-depth): one channel. normal: unit in the world, zero where empty.
        """
        surfels, environment = self.model.surfels, self.model.environment
        if self.incident is None:
            return split_sum_maps(camera, surfels, environment, self.straight)
        specular_at = self.model.plan.specular_among(surfels.albedo)
        return shaded_maps(camera, surfels, surfels.albedo, self.incident, environment, specular_at, self.straight)
