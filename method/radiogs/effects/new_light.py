"""Effects that relighting by a new light needs, and whether it needs directions drawn from the light.

A model is probed again under every new light: a sun needs shadows that an overcast sky did not.
"""

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import Run
from radiogs_core.learning.views import load
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident, unoccluded
from radiogs_core.transport.sampling import hemisphere_directions, relighting_directions
from radiogs_core.transport.splatting import own_radiance, shade_surfels

from ..model import Model
from ..rays import RaySettings
from ..settings import Budget, Variant
from .bounds import bootstrap_t
from .decision import TOLERANCE_DB, Evidence, Measured, Tolerance, decide
from .images import CoveredPixels, ReferenceImage, mean_error, rendered_views
from .plans import Step
from .probe import LEVEL, Findings, Occasion, probe
from .probe_scene import PROBE_VIEWS, ProbeRays, ProbeScene, ProbeView, Viewpoints, trace_scene

CHECKED = 128
"""Number of surfels that are shaded with and without directions drawn from the light."""

REFERENCE_DIRECTIONS = (16384, 8192)
"""Directions of the reference: over the hemisphere, and drawn from the light. Directions over the hemisphere are 1.1
degrees apart; for most surfels they alone would miss a sun half a degree wide."""

DRAWS = 16
"""Number of times that each surfel's directions are drawn, because a few directions hit a sun only by chance."""

DIRECTIONS = 8
"""Directions over the hemisphere, and as many drawn from the light, that a probe traces from every surfel, twice: a
quarter of the rays of relighting with preset tiny. Over the hemisphere alone a probe would miss a sun and its
occluders."""

IN_RELIGHTING = ("visibility", "indirect", "specular")
"""Effects that a probe of relighting measures in images."""


def colour_along_normals(
    surfels: Surfels, incident: Incident, environment: Float[Tensor, "rows columns 3"]
) -> Float[Tensor, "surfels 3"]:
    """Display colour (sRGB) of surfels seen along their normals. ``environment``: linear radiance of the light."""
    along = surfels.frame[:, None, :, 2]
    return srgb_encode(shade_surfels(surfels, surfels.albedo, incident, along, environment)[:, 0].sum(1))


@torch.no_grad()
def decide_light_sampling(
    surfels: Surfels,
    light: EnvironmentMap,
    tolerance: Tolerance,
    spread: int,
    drawn: int,
    seed: int,
) -> Evidence:
    """Decides whether ``drawn`` directions from the light, added to ``spread`` over the hemisphere, improve images.

    The colours with and without them are compared with ``reference_colour``, for CHECKED surfels without occlusion,
    seen along their normals. Verdict "on": directions are drawn from the light.
    """
    generator = torch.Generator(surfels.centre.device).manual_seed(seed)
    chosen = torch.randperm(len(surfels), generator=generator, device=surfels.centre.device)[:CHECKED]
    some = surfels.take(chosen)
    truth = reference_colour(some, light, generator).repeat_interleave(DRAWS, 0)
    some = some.take(torch.arange(len(some), device=truth.device).repeat_interleave(DRAWS))
    normal = some.frame[..., 2]

    def error(directions: tuple[Tensor, Tensor]) -> Float[Tensor, " surfels"]:
        colour = colour_along_normals(some, unoccluded(*directions), light.radiance)
        return (colour - truth).square().mean(-1).view(-1, DRAWS).mean(1)

    without = error(hemisphere_directions(normal, spread, generator))
    rise = without - error(relighting_directions(normal, LightSampler(light), spread, drawn, generator))
    below, above = bootstrap_t(rise[None], LEVEL, torch.Generator().manual_seed(seed))
    measured = Measured(
        contribution=tolerance.loss(float(rise.mean())),
        lowest=tolerance.loss(float(below)),
        bound=tolerance.loss(float(above)),
        worst=tolerance.worst_case(float(without.mean())),
        share=drawn / (spread + drawn),
        rays=len(surfels) * drawn,
    )
    verdict, why = decide(measured, was_off=False, tolerance=tolerance.decibel)
    return Evidence("light-sampling", verdict, why, 0, seed, tolerance.decibel, measured)


@torch.no_grad()
def reference_colour(surfels: Surfels, light: EnvironmentMap, generator: torch.Generator) -> Float[Tensor, "surfels 3"]:
    """Display colour (sRGB) along the normals under an unoccluded light, from REFERENCE_DIRECTIONS."""
    directions = relighting_directions(
        surfels.frame[..., 2], LightSampler(widened_light(light)), *REFERENCE_DIRECTIONS, generator
    )
    return colour_along_normals(surfels, unoccluded(*directions), light.radiance)


def widened_light(light: EnvironmentMap) -> EnvironmentMap:
    """The light with each texel raised to its brightest neighbour, as a density to draw directions from.

    Light is interpolated, so a sun extends into the next texels. If directions were drawn from the map itself, the ones
    in the next texels would be rare and have large weights (``tests/method/radiogs/effects/test_effect_probe.py``).
    """
    around = light.radiance.permute(2, 0, 1)[None]
    around = torch.nn.functional.pad(around, (1, 1, 0, 0), mode="circular")
    around = torch.nn.functional.pad(around, (0, 0, 1, 1), mode="replicate")
    return EnvironmentMap(torch.nn.functional.max_pool2d(around, 3, stride=1)[0].permute(1, 2, 0))


@torch.no_grad()
def model_error(surfels: Surfels, viewpoints: Viewpoints) -> float:
    """Mean squared error, display sRGB, of the images of the surfels' own radiance against the views' targets."""
    views = viewpoints.views
    projections = [surfels.seen_by(view.camera, radiance=False) for view in views]
    own = torch.stack([own_radiance(view.camera, surfels) for view in views], 1)
    rendered = rendered_views(projections, [own])
    pixels = CoveredPixels.of(views, rendered, viewpoints.straight)
    (image,) = pixels.take(rendered)
    return mean_error(ReferenceImage.of(image, pixels), pixels)


def scene_under(
    surfels: Surfels,
    albedo: Float[Tensor, "surfels 3"],
    light: EnvironmentMap,
    viewpoints: Viewpoints,
    seed: int,
    variant: RaySettings,
    offset: float | None = None,
) -> ProbeScene:
    """A model under a new light, traced for a probe. The views lose their targets, which show the training light.

    ``albedo``: linear, scaled for relighting. ``variant``: rays of relighting. ``offset``: distance from their surfel
    at which rays start, in its standard deviations; None: as in relighting, because images contain the effect of close
    occluders, too, and nothing is learnt that could compensate it. L_ind is the light scattered by one surface, as in
    relighting; the surfels' own radiance belongs to the training light.
    """
    painted = Surfels.of(surfels.parameters() | {"albedo_logit": torch.logit(albedo.clamp(1e-4, 1 - 1e-4))})
    generator = torch.Generator(surfels.centre.device).manual_seed(seed)
    blind = replace(viewpoints, views=tuple(ProbeView(view.camera, None) for view in viewpoints.views))
    rays = ProbeRays(DIRECTIONS, generator, variant, offset, drawn=DIRECTIONS)
    scene = replace(trace_scene(painted, light.radiance, blind, rays, bounces=True), given_light=True)
    assert scene.first is not None
    return replace(scene, incident=replace(scene.incident, radiance=scene.first))


def plan_for_light(
    scene: ProbeScene, mse: float, spread: int, drawn: int, seed: int, decibel: float = TOLERANCE_DB
) -> Findings:
    """The plan for relighting a scene of ``scene_under``, with its evidence.

    ``mse``: the model's own error (``model_error``). ``spread``, ``drawn``: numbers of relighting's directions over the
    hemisphere and from the light. ``decibel``: tolerated loss, dB of PSNR. Raises NumericalFailure if a
    surfel in a view has a radiance that is not finite.
    """
    # Every surfel is traced once, as in a step that only refreshes the cached light.
    step = Step(len(scene.surfels), 0, spread + drawn, 1)
    findings = probe(scene, step, Occasion(seed), IN_RELIGHTING, decibel, mse)
    light = EnvironmentMap(scene.environment)
    sampling = decide_light_sampling(scene.surfels, light, findings.tolerance, spread, drawn, seed)
    return findings.extended(sampling, light_sampling=sampling.verdict == "on")


def training_viewpoints(run: Run[Variant, Budget], device: torch.device) -> Viewpoints:
    """The training views of a probe: PROBE_VIEWS of them, evenly spread over the list, with their images on black."""
    scene = run.scene
    chosen = scene.train[:: max(1, len(scene.train) // PROBE_VIEWS)][:PROBE_VIEWS]
    views = tuple(ProbeView(view.camera, view.over(0.0)) for view in load(chosen, device))
    return Viewpoints(views, run.variant.straight)


def probe_relighting(
    model: Model,
    light: EnvironmentMap,
    albedo_scale: Float[Tensor, "3"],
    run: Run[Variant, Budget],
    offset: float | None = None,
) -> tuple[ProbeScene, Findings]:
    """Probes a model under ``light``: the scene of the probe, and the plan for relighting with its evidence.

    ``offset``: see ``scene_under``.
    """
    surfels, device = model.surfels, model.surfels.centre.device
    viewpoints = training_viewpoints(run, device)
    albedo = surfels.albedo.detach() * albedo_scale.to(device)
    light, rays = EnvironmentMap(light.radiance.to(device)), RaySettings.of(run.variant)
    scene = scene_under(surfels, albedo, light, viewpoints, run.seed, rays, offset)
    directions = run.budget.relight_hemisphere_samples, run.budget.relight_light_samples
    return scene, plan_for_light(scene, model_error(surfels, viewpoints), *directions, run.seed)
