"""Relighting by ray tracing: new light, traced visibility, indirect light by split-sum at the traced hits."""

import torch
from jaxtyping import Float
from torch import Tensor

from .budget import Budget
from .camera import Camera
from .incident import Incident, SurfelTracer, visibility_of
from .light import EnvironmentMap
from .model import Model
from .rendering import shaded_maps
from .sampling import relighting_directions
from .splitsum import PrefilteredLight, split_sum_radiance

RAYS_AT_ONCE = 1 << 18


class Relit:
    """A model under another light, ready to be seen from any camera (paper, section on relighting).

    Directions are spread over each surfel's hemisphere and drawn from the light, joined by the balance
    heuristic; L_ind is the split-sum radiance of the blended material met by the ray, under unoccluded light
    (one bounce). ``albedo_scale`` [3] multiplies the recovered albedo (the ambiguity between light and albedo).
    """

    def __init__(
        self, model: Model, light: EnvironmentMap, albedo_scale: Float[Tensor, "3"], budget: Budget, seed: int
    ) -> None:
        device = model.surfels.centre.device
        generator = torch.Generator(device).manual_seed(seed)
        self.environment = light.radiance.to(device)
        with torch.no_grad():
            self.surfels = model.surfels
            self.albedo = model.surfels.albedo * albedo_scale.to(device)
            direction, weight = relighting_directions(
                model.surfels.frame[..., 2],
                EnvironmentMap(self.environment),
                budget.relight_hemisphere_samples,
                budget.relight_light_samples,
                generator,
            )
            self.incident = self._incident(direction, weight)

    def _incident(self, direction: Tensor, weight: Tensor) -> Incident:
        tracer = SurfelTracer(self.surfels)
        prefiltered = PrefilteredLight(self.environment)
        normal = self.surfels.frame[..., 2]
        features = torch.cat([normal, self.albedo, self.surfels.roughness[:, None]], -1)
        together = max(1, RAYS_AT_ONCE // direction.shape[1])
        visibility, radiance = [], []
        for index in torch.arange(len(self.surfels), device=direction.device).split(together):
            hits = tracer.trace(index, direction[index], features)
            seen, whole = visibility_of(hits)
            blended = hits.features / torch.where(hits.transmittance < 1, 1 - hits.transmittance, 1.0)[:, None]
            length = blended[:, :3].square().sum(-1, keepdim=True)
            met_normal = blended[:, :3] * torch.where(length > 0, length, torch.inf).rsqrt()
            diffuse, specular = split_sum_radiance(
                met_normal, blended[:, 3:6], blended[:, 6], -direction[index].flatten(0, 1), prefiltered
            )
            coverage = (1 - hits.transmittance) * whole
            visibility.append(seen.view(len(index), -1))
            radiance.append(((diffuse + specular) * coverage[:, None]).view(len(index), -1, 3))
        return Incident(direction, weight, torch.cat(visibility), torch.cat(radiance))

    def render(self, camera: Camera) -> dict[str, Float[Tensor, "height width _"]]:
        """The same maps as ``Renderer.render``, under the new light."""
        return shaded_maps(camera, self.surfels, self.albedo, self.incident, self.environment)
