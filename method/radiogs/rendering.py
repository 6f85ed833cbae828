"""A trained model under the light it was trained in, shaded by the rules it was trained by, along more directions."""

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.maps import incident_map, shaded_maps, split_sum_maps
from radiogs_core.transport.sampling import LightSampler, relighting_directions
from radiogs_core.transport.tracer import gather_incident, incident_along

from .model import Model
from .tracing import Rays
from .variant import Variant

DENSER = 2
"""Directions over the hemisphere for each of training's, and as many drawn from the light. In training a surfel's
directions change from step to step, and what one set errs by averages out; a view is shaded from one."""


class Renderer:
    """A trained model under the light it was trained in, ready to be seen from any camera.

    For Monte-Carlo shading, incident light is traced once, along ``DENSER`` times ``samples`` directions over the
    hemisphere of each surfel and as many drawn from the light, weighted by the balance heuristic: few directions over
    the hemisphere miss a sun, and where they are not turned all surfels of a wall miss it alike. With the deviation
    ``spread-views`` there are ``samples`` over the hemisphere alone, not turned. What the model's plan left out stays
    out. Surfels that kept their light in training are traced with all others. Indirect light that was given in training
    is given here too. Two renderers of one model have the same directions.
    """

    def __init__(self, model: Model, samples: int, variant: Variant) -> None:
        self.model, self.incident, self.straight = model, None, variant.straight
        if variant.shading == "monte-carlo":
            self.incident = _incident(model, samples, variant)

    def incident_map(self, camera: Camera) -> Float[Tensor, "height width 3"]:
        """The indirect radiance that arrives (see ``maps.incident_map``); not for split-sum shading."""
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


@torch.no_grad()
def _incident(model: Model, samples: int, variant: Variant) -> Incident:
    """The light that arrives at each surfel along the directions that new views are shaded from."""
    rays, surfels, plan = Rays.of(variant, model.indirect), model.surfels, model.plan.at_once
    tracer = rays.tracer(surfels)
    if "spread-views" in variant.deviations:
        return gather_incident(tracer, surfels, samples, None, rays.floor, plan)
    generator = torch.Generator(surfels.centre.device).manual_seed(0)
    light = LightSampler(EnvironmentMap(model.environment))
    each = DENSER * samples
    directions = relighting_directions(surfels.frame[..., 2], light, each, each, generator, rays.floor)
    return incident_along(tracer, *directions, plan)
