"""Relighting (paper, section on relighting): by rays with split-sum or learnt indirect light, or by surfels alone."""

from collections.abc import Callable, Sequence
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.learning.radiance_solver import RadianceSolver, RenderingEquation, SolverBudget
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident, unoccluded
from radiogs_core.transport.plan import EffectPlan
from radiogs_core.transport.sampling import LightSampler, relighting_directions
from radiogs_core.transport.splatting import radiance_maps, shaded_maps
from radiogs_core.transport.splitsum import PrefilteredLight, split_sum_radiance
from radiogs_core.transport.tracer import EVERYTHING, RAYS_AT_ONCE, SurfelTracer, incident_along, visibility_of

from .budget import Budget
from .model import Model
from .variant import Relighting


@runtime_checkable
class Relit(Protocol):
    """A model under another light, ready to be seen from any camera."""

    def render(self, camera: Camera) -> dict[str, Float[Tensor, "height width _"]]:
        """Maps of one view, [height, width, channels], on black; at least ``image`` (display sRGB) and ``alpha``."""


def relight(
    model: Model,
    light: EnvironmentMap,
    albedo_scale: Float[Tensor, "3"],
    cameras: Sequence[Camera],
    budget: Budget,
    seed: int,
    mode: Relighting = "pbr",
    plan: EffectPlan = EVERYTHING,
    after_step: Callable[[], None] = lambda: None,
) -> Relit:
    """The model under ``light``; ``mode`` is explained in ``variant``.

    ``plan`` is what the rays simulate (``effects.lighting`` makes one for a light); fine-tuning always has everything.
    ``albedo_scale`` multiplies the recovered albedo (the ambiguity between light and albedo). ``cameras`` are where
    fine-tuning looks from; the training views do. ``after_step`` is called after each of its steps, and may raise to
    end it. Raises DataError for a light that is not finite.
    """
    surfels = model.surfels
    device = surfels.centre.device
    light = EnvironmentMap(light.radiance.to(device))
    albedo = surfels.albedo.detach() * albedo_scale.to(device)
    if mode != "pbr":
        effort = SolverBudget(budget.finetune_iterations, budget.finetune_surfels, budget.finetune_samples)
        solver = RadianceSolver(surfels, RenderingEquation(light, albedo), cameras, effort, seed)
        while solver.iteration < solver.iterations:
            solver.step()
            after_step()
        surfels = solver.surfels
    if mode == "surfels":
        return RelitBySurfels(surfels)
    generator = torch.Generator(device).manual_seed(seed)
    with torch.no_grad():
        direction, weight = relighting_directions(
            surfels.frame[..., 2], LightSampler(light),
            budget.relight_hemisphere_samples, budget.relight_light_samples if plan.light_sampling else 0, generator,
        )  # fmt: skip
        tracer = SurfelTracer(surfels)
        if mode == "pbr":
            incident = split_sum_incident(tracer, surfels, albedo, light, direction, weight, plan)
        else:
            incident = incident_along(tracer, direction, weight, plan)
    return RelitByRays(surfels, albedo, light, incident, plan)


class RelitByRays:
    """Shaded at every surfel from what its rays met: V once, L_ind once, the BRDF anew for every camera."""

    def __init__(
        self,
        surfels: Surfels,
        albedo: Float[Tensor, "surfels 3"],
        light: EnvironmentMap,
        incident: Incident,
        plan: EffectPlan = EVERYTHING,
    ) -> None:
        self.surfels, self.albedo, self.light, self.incident = surfels, albedo, light, incident
        self.specular = plan.specular_among(albedo)

    def render(self, camera: Camera) -> dict[str, Float[Tensor, "height width _"]]:
        """The same maps as ``Renderer.render``, under the new light."""
        return shaded_maps(camera, self.surfels, self.albedo, self.incident, self.light.radiance, self.specular)


class RelitBySurfels:
    """The radiance that fine-tuning has left in the surfels, splatted: no ray, no shading."""

    def __init__(self, surfels: Surfels) -> None:
        self.surfels = surfels

    @torch.no_grad()
    def render(self, camera: Camera) -> dict[str, Float[Tensor, "height width _"]]:
        """``image`` and ``alpha``: what light is direct and what indirect, surfels do not know."""
        return radiance_maps(camera, self.surfels)


def split_sum_incident(
    tracer: SurfelTracer,
    surfels: Surfels,
    albedo: Float[Tensor, "surfels 3"],
    light: EnvironmentMap,
    direction: Float[Tensor, "surfels samples 3"],
    weight: Float[Tensor, "surfels samples"],
    plan: EffectPlan = EVERYTHING,
) -> Incident:
    """Incident light whose L_ind is the split-sum radiance of the blended material that a ray meets.

    The surfels' own radiance belongs to another light; the met surface is lit by the new one, unoccluded (one bounce).
    What ``plan`` leaves out is not traced.
    """
    every = torch.arange(len(surfels), device=direction.device)
    incident = unoccluded(direction, weight) if plan.traces_all else tracer.untraced(every, direction, weight)
    chosen = plan.traced_among(every)
    prefiltered = PrefilteredLight(light.radiance)
    features = torch.cat([surfels.frame[..., 2], albedo, surfels.roughness[:, None]], -1)
    together = max(1, RAYS_AT_ONCE // direction.shape[1])
    for index in chosen.split(together) if len(chosen) else ():
        hits = tracer.trace(index, direction[index], features)
        seen, whole = visibility_of(hits)
        blended = hits.features / torch.where(hits.transmittance < 1, 1 - hits.transmittance, 1.0)[:, None]
        length = blended[:, :3].square().sum(-1, keepdim=True)
        met_normal = blended[:, :3] * torch.where(length > 0, length, torch.inf).rsqrt()
        diffuse, specular = split_sum_radiance(
            met_normal, blended[:, 3:6], blended[:, 6], -direction[index].flatten(0, 1), prefiltered
        )
        coverage = (1 - hits.transmittance) * whole
        if plan.visibility:
            incident.visibility[index] = seen.view(len(index), -1)
        if plan.indirect:
            incident.radiance[index] = ((diffuse + specular) * coverage[:, None]).view(len(index), -1, 3)
    return incident
