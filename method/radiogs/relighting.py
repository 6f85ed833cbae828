"""Relighting (paper, section on relighting): by rays with split-sum or learnt indirect light, or by surfels alone."""

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import Run
from radiogs_core.learning.radiance_solver import RadianceSolver, RenderingEquation, SolverBudget
from radiogs_core.learning.views import load
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.hit_surface import hit_features, hit_radiance, traced_openness
from radiogs_core.transport.incident import Incident, unoccluded
from radiogs_core.transport.maps import radiance_maps, shaded_maps
from radiogs_core.transport.plan import EffectPlan, plan_of
from radiogs_core.transport.sampling import LightSampler, relighting_directions
from radiogs_core.transport.splitsum import PrefilteredLight
from radiogs_core.transport.tracer import EVERYTHING, RAYS_AT_ONCE, SurfelTracer, incident_along

from .effects.evidence import Evidence
from .effects.image_share import image_share
from .effects.new_light import model_error, plan_for_light, scene_under
from .effects.planner import PROBE_VIEWS
from .effects.probe import Findings
from .effects.probe_scene import ProbeScene, ProbeView, Viewpoints
from .model import Model
from .tracing import Rays


@runtime_checkable
class Relit(Protocol):
    """A model under another light, ready to be seen from any camera."""

    evidence: tuple[Evidence, ...]
    """Evidence of the probe that decided what is simulated; empty without a probe."""

    def render(self, camera: Camera) -> dict[str, Float[Tensor, "height width _"]]:
        """Maps of one view, [height, width, channels], on black; at least ``image`` (display sRGB) and ``alpha``."""


def relit_under(
    model: Model,
    light: EnvironmentMap,
    albedo_scale: Float[Tensor, "3"],
    run: Run,
    after_step: Callable[[], None] = lambda: None,
    share: Float[Tensor, " surfels"] | None = None,
) -> Relit:
    """The model under ``light``, simulating what the run's variant says: with effects "auto", what a probe finds.

    ``share``: ``training_share`` of the surfels where it is known already; a probe needs it. See ``relight``.
    """
    if run.variant.effects != "auto":
        return relight(model, light, albedo_scale, run, plan_of(run.variant.effects), after_step)
    _, found = probe_relighting(model, light, albedo_scale, run, share)
    relit = relight(model, light, albedo_scale, run, found.plan, after_step)
    relit.evidence = found.evidence
    return relit


def relight(
    model: Model,
    light: EnvironmentMap,
    albedo_scale: Float[Tensor, "3"],
    run: Run,
    plan: EffectPlan = EVERYTHING,
    after_step: Callable[[], None] = lambda: None,
) -> Relit:
    """The model under ``light``, in the mode of the run's variant (``variant.Relighting``).

    ``plan`` is what the rays simulate; fine-tuning always has everything. ``albedo_scale`` multiplies the recovered
    albedo (the ambiguity between light and albedo). Fine-tuning looks from the run's training views. ``after_step`` is
    called after each of its steps, and may raise to end it. Raises DataError for a light that is not finite.
    """
    surfels, mode = model.surfels, run.variant.relighting
    device = surfels.centre.device
    light = EnvironmentMap(light.radiance.to(device))
    albedo = surfels.albedo.detach() * albedo_scale.to(device)
    if mode != "pbr":
        surfels = fine_tuned(surfels, RenderingEquation(light, albedo), run, after_step)
    if mode == "surfels":
        return RelitBySurfels(surfels, run.variant.straight)
    generator, budget, rays = torch.Generator(device).manual_seed(run.seed), run.budget, Rays.of(run.variant)
    with torch.no_grad():
        direction, weight = relighting_directions(
            surfels.frame[..., 2], LightSampler(light),
            budget.relight_hemisphere_samples, budget.relight_light_samples if plan.light_sampling else 0, generator,
            rays.floor,
        )  # fmt: skip
        tracer = rays.tracer(surfels)
        if mode == "pbr":
            is_open = None
            if run.variant.met_light == "occluded":
                is_open = traced_openness(tracer, surfels, budget.relight_hemisphere_samples, rays.floor, plan)
            features = hit_features(surfels, albedo, is_open)
            incident = split_sum_incident(tracer, features, light, direction, weight, plan)
        else:
            incident = incident_along(tracer, direction, weight, plan)
    return RelitByRays(surfels, albedo, light, incident, plan, run.variant.straight)


def fine_tuned(surfels: Surfels, equation: RenderingEquation, run: Run, after_step: Callable[[], None]) -> Surfels:
    """The surfels with the radiance that solves ``equation``, as far as the run's budget goes."""
    budget, cameras = run.budget, [view.camera for view in run.scene.train]
    effort = SolverBudget(budget.finetune_iterations, budget.finetune_surfels, budget.finetune_samples)
    rays = Rays.of(run.variant)
    solver = RadianceSolver(surfels, equation, cameras, effort, run.seed, rays.tracer, rays.floor)
    while solver.iteration < solver.iterations:
        solver.step()
        after_step()
    return solver.surfels


def training_share(scene: Scene, surfels: Surfels) -> Float[Tensor, " surfels"]:
    """Each surfel's share of the training images."""
    return image_share((view.camera for view in scene.train), surfels)


def training_viewpoints(run: Run, surfels: Surfels, share: Float[Tensor, " surfels"] | None = None) -> Viewpoints:
    """Training views that a probe looks from, evenly spread over their list, with their images on black.

    ``share``: ``training_share`` of the surfels where it is known already.
    """
    scene = run.scene
    chosen = scene.train[:: max(1, len(scene.train) // PROBE_VIEWS)][:PROBE_VIEWS]
    views = tuple(ProbeView(view.camera, view.over(0.0)) for view in load(chosen, surfels.centre.device))
    share = training_share(scene, surfels) if share is None else share
    return Viewpoints(views, share, run.variant.straight)


def probe_relighting(
    model: Model,
    light: EnvironmentMap,
    albedo_scale: Float[Tensor, "3"],
    run: Run,
    share: Float[Tensor, " surfels"] | None = None,
    offset: float | None = None,
) -> tuple[ProbeScene, Findings]:
    """What relighting a model by ``light`` may leave out, and the scene that was probed.

    ``share``: as for ``relit_under``. ``offset``: where rays start, in standard deviations; None: where those of
    the variant do.
    """
    surfels, device = model.surfels, model.surfels.centre.device
    viewpoints = training_viewpoints(run, surfels, share)
    albedo = surfels.albedo.detach() * albedo_scale.to(device)
    light, rays = EnvironmentMap(light.radiance.to(device)), Rays.of(run.variant)
    scene = scene_under(surfels, albedo, light, viewpoints, run.seed, rays, offset)
    directions = run.budget.relight_hemisphere_samples, run.budget.relight_light_samples
    return scene, plan_for_light(scene, model_error(surfels, viewpoints), *directions, run.seed)


class RelitByRays:
    """Shaded at every surfel from what its rays met: V once, L_ind once, the BRDF anew for every camera."""

    def __init__(
        self,
        surfels: Surfels,
        albedo: Float[Tensor, "surfels 3"],
        light: EnvironmentMap,
        incident: Incident,
        plan: EffectPlan = EVERYTHING,
        straight: bool = True,
    ) -> None:
        self.surfels, self.albedo, self.light, self.incident = surfels.framed(), albedo, light, incident
        self.straight = straight
        self.specular = plan.specular_among(albedo)
        self.evidence: tuple[Evidence, ...] = ()

    def render(self, camera: Camera) -> dict[str, Float[Tensor, "height width _"]]:
        """The maps of ``Renderer.render``, under the new light."""
        return shaded_maps(
            camera, self.surfels, self.albedo, self.incident, self.light.radiance, self.specular, self.straight
        )


class RelitBySurfels:
    """The radiance that fine-tuning has left in the surfels, rendered_views: no ray, no shading."""

    def __init__(self, surfels: Surfels, straight: bool = True) -> None:
        self.surfels, self.straight = surfels.framed(), straight
        self.evidence: tuple[Evidence, ...] = ()

    @torch.no_grad()
    def render(self, camera: Camera) -> dict[str, Float[Tensor, "height width _"]]:
        """``image`` and ``alpha``: what light is direct and what indirect, surfels do not know."""
        return radiance_maps(camera, self.surfels, self.straight)


def split_sum_incident(
    tracer: SurfelTracer,
    features: Float[Tensor, "surfels _"],
    light: EnvironmentMap,
    direction: Float[Tensor, "surfels samples 3"],
    weight: Float[Tensor, "surfels samples"],
    plan: EffectPlan = EVERYTHING,
) -> Incident:
    """Incident light whose L_ind is the split-sum radiance of the blended material that a ray meets (``hit_surface``).

    The surfels' own radiance belongs to another light; ``features`` are those of ``hit_features``. What ``plan`` leaves
    out is not traced.
    """
    every = torch.arange(len(features), device=direction.device)
    incident = unoccluded(direction, weight) if plan.traces_all else tracer.untraced(every, direction, weight)
    chosen = plan.traced_among(every)
    prefiltered = PrefilteredLight(light.radiance)
    together = max(1, RAYS_AT_ONCE // direction.shape[1])
    for index in chosen.split(together) if len(chosen) else ():
        hits = tracer.trace(index, direction[index], features)
        seen, radiance = hit_radiance(hits, direction[index].flatten(0, 1), prefiltered)
        if plan.visibility:
            incident.visibility[index] = seen.view(len(index), -1)
        if plan.indirect:
            incident.radiance[index] = radiance.view(len(index), -1, 3)
    return incident
