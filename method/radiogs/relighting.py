"""Relighting (paper, section on relighting): by rays with one of several kinds of L_ind, or by surfels alone."""

from collections.abc import Callable, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import Maps, Run
from radiogs_core.learning.radiance_solver import RadianceSolver, RenderingEquation, SolverBudget
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.lamps import Lamp
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.hit_surface import hit_features, hit_radiance, traced_openness
from radiogs_core.transport.incident import Incident, unoccluded
from radiogs_core.transport.interreflection import bounced_incident
from radiogs_core.transport.lamp_light import lamp_light, with_lamps
from radiogs_core.transport.maps import radiance_maps, shaded_maps
from radiogs_core.transport.path_tracing import PathTracer
from radiogs_core.transport.plan import EffectPlan
from radiogs_core.transport.prefiltered_light import PrefilteredLight
from radiogs_core.transport.sampling import relighting_directions
from radiogs_core.transport.tracer import EVERYTHING, RAYS_AT_ONCE, SurfelTracer, incident_along

from .model import Model
from .rays import RaySettings
from .settings import PATH, RELIGHTING, Budget, Variant


def relight(
    model: Model,
    light: EnvironmentMap,
    albedo_scale: Float[Tensor, "3"],
    run: Run[Variant, Budget],
    after_step: Callable[[], None] = lambda: None,
    plan: EffectPlan = EVERYTHING,
    lamps: Sequence[Lamp] = (),
) -> "RelitByRays | RelitBySurfels":
    """The model under ``light``, in the mode of the run's variant (``settings.Relighting``).

    ``albedo_scale``: factor for each channel of the recovered albedo, which images determine only up to such a factor.
    ``after_step``: called after each step of fine-tuning, which uses the run's training cameras, and between parts of
    path tracing; it may raise to end them. ``plan``: the effects that rays simulate; fine-tuning and path tracing
    simulate all of them. ``lamps`` shine beside ``light``, in mode "bounces". Raises DataError for a light that is not
    finite, UsageError as ``lamp_light`` does.
    """
    surfels, variant = model.surfels, run.variant
    device = surfels.centre.device
    light = EnvironmentMap(light.radiance.to(device))
    albedo = surfels.albedo.detach() * albedo_scale.to(device)
    if variant.relighting in RELIGHTING.by_steps:
        surfels = fine_tuned(surfels, RenderingEquation(light, albedo), run, after_step)
    if variant.relighting == "surfels":
        return RelitBySurfels(surfels, variant.straight)
    if variant.relighting == PATH:
        return path_traced(surfels, albedo, light, run, after_step)
    generator, budget, rays = torch.Generator(device).manual_seed(run.seed), run.budget, RaySettings.of(variant)
    with torch.no_grad():
        direction, weight = directions = relighting_directions(
            surfels.frame[..., 2], LightSampler(light),
            budget.relight_hemisphere_samples, budget.relight_light_samples if plan.light_sampling else 0, generator,
            rays.floor,
        )  # fmt: skip
        tracer, shone = rays.tracer(surfels), None
        if variant.relighting == "finetuned":
            incident = incident_along(tracer, direction, weight, plan)
        elif variant.relighting == "bounces":
            count = budget.relight_bounces if plan.bounces else 1
            shone = lamp_light(tracer, lamps) if lamps else None
            incident = bounced_incident(tracer, albedo, light.radiance, directions, count, plan, shone)
        else:
            is_open = None
            if variant.met_light == "occluded":
                is_open = traced_openness(tracer, surfels, budget.relight_hemisphere_samples, rays.floor, plan)
            features = hit_features(surfels, albedo, is_open)
            incident = split_sum_incident(
                tracer, features, PrefilteredLight(light.radiance, variant.masking), direction, weight, plan
            )
    return RelitByRays(surfels, albedo, light, incident, plan, variant.straight, shone)


@torch.no_grad()
def path_traced(
    surfels: Surfels,
    albedo: Float[Tensor, "surfels 3"],
    light: EnvironmentMap,
    run: Run[Variant, Budget],
    after_step: Callable[[], None],
) -> "RelitByRays":
    """The surfels under ``light`` with one path along each direction, half of these drawn from the light.

    All effects are simulated. The directions have no floor, which is a deviation of the estimator and not of the
    model (``hemisphere-floor``); origins and sides of rays are as in the run's variant.
    """
    generator = torch.Generator(surfels.centre.device).manual_seed(run.seed)
    drawn = run.budget.relight_paths // 2
    directions = relighting_directions(
        surfels.frame[..., 2], LightSampler(light), run.budget.relight_paths - drawn, drawn, generator
    )
    tracer = RaySettings.of(run.variant).tracer(surfels)
    incident = PathTracer(tracer, albedo, light, generator).incident(*directions, after_step)
    return RelitByRays(surfels, albedo, light, incident, straight=run.variant.straight)


def fine_tuned(
    surfels: Surfels, equation: RenderingEquation, run: Run[Variant, Budget], after_step: Callable[[], None]
) -> Surfels:
    """The surfels with radiance fitted to ``equation``, by the steps of the run's budget (stage 3)."""
    budget, cameras = run.budget, [view.camera for view in run.scene.train]
    effort = SolverBudget(
        budget.finetune_iterations, budget.finetune_surfels, budget.finetune_samples, run.variant.finetuning
    )
    rays = RaySettings.of(run.variant)
    solver = RadianceSolver(surfels, equation, cameras, effort, run.seed, rays.tracer, rays.floor)
    while solver.iteration < solver.iterations:
        solver.step()
        after_step()
    return solver.surfels


class RelitByRays:
    """Shades every surfel from V and L_ind, which are traced once; the BRDF is evaluated for every camera."""

    def __init__(
        self,
        surfels: Surfels,
        albedo: Float[Tensor, "surfels 3"],
        light: EnvironmentMap,
        incident: Incident,
        plan: EffectPlan = EVERYTHING,
        straight: bool = True,
        lamps: Incident | None = None,
    ) -> None:
        self.surfels, self.albedo, self.light, self.incident = surfels.with_cached_values(), albedo, light, incident
        self.straight, self.lamps = straight, lamps
        self.specular = plan.specular_among(albedo)

    def render(self, camera: Camera, *further: str) -> Maps:
        """The maps of ``Renderer.render``, under the new light."""
        maps = shaded_maps(
            camera, self.surfels, self.albedo, self.incident, self.light.radiance, self.specular, self.straight
        )
        return (
            maps
            if self.lamps is None
            else with_lamps(maps, camera, self.surfels, self.albedo, self.lamps, self.straight)
        )


class RelitBySurfels:
    """Renders the surfels' fine-tuned radiance; no rays, no shading."""

    def __init__(self, surfels: Surfels, straight: bool = True) -> None:
        self.surfels, self.straight = surfels.with_cached_values(), straight

    @torch.no_grad()
    def render(self, camera: Camera, *further: str) -> Maps:
        """The maps ``image`` and ``alpha``; the radiance is not split into direct and indirect light."""
        return radiance_maps(camera, self.surfels, self.straight)


def split_sum_incident(
    tracer: SurfelTracer,
    features: Float[Tensor, "surfels _"],
    prefiltered: PrefilteredLight,
    direction: Float[Tensor, "surfels samples 3"],
    weight: Float[Tensor, "surfels samples"],
    plan: EffectPlan = EVERYTHING,
) -> Incident:
    """Incident light whose L_ind is the split-sum radiance of the blended material that a ray hits (``hit_surface``).

    The surfels' own radiance is not used, because it belongs to the training light. ``features``: see ``hit_features``.
    ``prefiltered``: the new light. ``direction``, ``weight``: unit directions and their solid angles. ``plan``: the
    effects that are traced.
    """
    every = torch.arange(len(features), device=direction.device)
    incident = unoccluded(direction, weight) if plan.traces_all else tracer.untraced(every, direction, weight)
    for index in every.split(max(1, RAYS_AT_ONCE // direction.shape[1])) if plan.traces else ():
        hits = tracer.trace(index, direction[index], features)
        seen, radiance = hit_radiance(hits, direction[index].flatten(0, 1), prefiltered)
        if plan.visibility:
            incident.visibility[index] = seen.view(len(index), -1)
        if plan.indirect:
            incident.radiance[index] = radiance.view(len(index), -1, 3)
    return incident
