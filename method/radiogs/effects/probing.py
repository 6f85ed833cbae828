"""The effects that RadioGS needs for the true scene or for a trained model: in training, or for relighting.

A probe of the true scene follows light over its surfels bounce by bounce (``solve_radiosity``), and measures the energy
that each bounce adds. ``difference_maps`` shows where effects matter.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.capabilities import EffectRecord, Probe
from radiogs_core.contract import Run
from radiogs_core.errors import DataError
from radiogs_core.kernels.image.display import displayed
from radiogs_core.learning.known_scene import OFFSET
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene
from radiogs_core.surfels.known_surfaces import surfels_on
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.plan import HIGHEST_DEGREE, EffectPlan
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_core.transport.splatting import DIFFUSE_DIRECT, SOLID_ALPHA, SPECULAR_DIRECT, shade_surfels
from radiogs_core.transport.tracer import SurfelTracer, visibility_of

from ..model import Model
from ..rays import RaySettings
from ..settings import Budget, Variant
from .images import light_factor, rendered_views
from .new_light import IN_RELIGHTING, decide_light_sampling, probe_relighting, training_viewpoints
from .plans import Step, plan_without
from .probe import Findings, Occasion, light_factor_is_free, probe
from .probe_scene import PlanRadiance, ProbeRays, ProbeScene, glowing, trace_scene

BOUNCES = 8
"""Number of surfaces that light is followed over, as in the images of generated scenes."""


@dataclass(frozen=True)
class Decay:
    """Decay of light from bounce to bounce."""

    energy: tuple[float, ...]
    """Scattered radiance after one surface, after two, and so on: means over surfels and channels, linear."""

    @property
    def ratio(self) -> float:
        """Ratio of the second energy to the first; 0 if no light arrives."""
        return self.energy[1] / self.energy[0] if self.energy[0] > 0 else 0.0

    def needed(self, first: float, tolerated: float) -> int:
        """Number of bounces after which the error of leaving out all further bounces is below ``tolerated``.

        ``first``: the error after one bounce. Both are squared errors, which fall by the square of the ratio with every
        further bounce.
        """
        if first <= tolerated or self.ratio <= 0:
            return 1
        fall = math.log(min(self.ratio, 0.99) ** 2)
        return 1 + math.ceil(math.log(tolerated / first) / fall)


EFFECTS = ("visibility", "indirect", "bounces", "specular")
"""Effects that a probe of a scene measures. View-dependence is not among them, because the true surfels have the same
radiance in all directions."""

EFFECTS_OF_MODELS = (*EFFECTS, "view-dependence")
"""Effects that a probe of a trained model measures."""

SPACING = 0.08
"""World units between the surfels on a scene's true surfaces; generated scenes are 2 to 3 units across."""


def probe_run(run: Run[Variant, Budget], model: Model | None, light: EnvironmentMap | None) -> Probe:
    """The effects that stage 2 with the run's budget needs, or, with a ``light``, relighting by it.

    ``model``: the trained model to probe; None: the true surfaces and light of the run's scene. Raises DataError if
    they are not known (see ``true_model``).
    """
    if light is not None:
        return report(*relighting_findings(run, model, light), IN_RELIGHTING)
    if model is not None:
        scene = probe_scene_of_model(run, model)
        return report(scene, training_findings(scene, run, EFFECTS_OF_MODELS), EFFECTS_OF_MODELS)
    scene, decay = probe_scene(run)
    findings = training_findings(scene, run)
    sampling = decide_light_sampling(
        scene.surfels, EnvironmentMap(scene.environment), findings.tolerance,
        run.budget.relight_hemisphere_samples, run.budget.relight_light_samples, run.seed,
    )  # fmt: skip
    findings = findings.extended(sampling, light_sampling=sampling.verdict == "on")
    return report(scene, findings, EFFECTS, bounces_needed(findings, decay))


def true_model(scene: Scene) -> tuple[Surfels, EnvironmentMap]:
    """Surfels on the true surfaces of a scene with their true materials, and its true light.

    Raises DataError if surfaces or light are not known, and for surfaces that emit light or have no specular lobe.
    """
    samples = None if scene.surfaces is None else scene.true_surfaces(SPACING)
    # The environment is the only light of a probe, and all surfels have a lobe.
    if samples is None or samples.emission is not None or not samples.specular or scene.training_light is None:
        raise DataError(
            f"the true surfaces and light of scene '{scene.name}' are not known, or a probe cannot use them",
            "Only generated scenes know them; of other scenes, only a trained model can be probed.",
            f"Train one, and probe its folder:  radiogs-bench train {scene.name} --out DIR",
        )
    return surfels_on(samples), scene.training_light


def probe_scene(run: Run[Variant, Budget]) -> tuple[ProbeScene, Decay]:
    """The run's scene with its true surfaces and light, and the decay of light in it.

    Raises DataError as ``true_model`` does.
    """
    samples, (surfels, light) = run.budget.incident_samples, true_model(run.scene)
    surfels, decay = solve_radiosity(surfels, light, samples, run.seed)
    rays = ProbeRays(samples, torch.Generator().manual_seed(run.seed), RaySettings.of(run.variant), OFFSET)
    return trace_scene(
        surfels, light.radiance, training_viewpoints(run, surfels.centre.device), rays, bounces=True
    ), decay


def probe_scene_of_model(run: Run[Variant, Budget], model: Model) -> ProbeScene:
    """The scene of a probe of a trained model, under its recovered light."""
    surfels = model.surfels
    generator = torch.Generator(surfels.centre.device).manual_seed(run.seed)
    rays = ProbeRays(run.budget.incident_samples, generator, RaySettings.of(run.variant))
    return trace_scene(surfels, model.environment, training_viewpoints(run, surfels.centre.device), rays, bounces=True)


def training_findings(scene: ProbeScene, run: Run[Variant, Budget], effects: tuple[str, ...] = EFFECTS) -> Findings:
    """The plan of stage 2 with the run's budget, with its evidence."""
    view = run.scene.train[0].camera
    step = Step.of(run.variant, run.budget, len(scene.surfels), view.width * view.height)
    return probe(scene, step, Occasion(run.seed), effects)


def relighting_findings(
    run: Run[Variant, Budget], model: Model | None, light: EnvironmentMap
) -> tuple[ProbeScene, Findings]:
    """The scene of the probe, and the plan of relighting by ``light`` with its evidence.

    ``model``: the trained model; None: the true surfaces and light of the scene. Raises DataError as ``true_model``
    does.
    """
    if model is not None:
        return probe_relighting(model, light, torch.ones(3), run)
    scene, _ = probe_scene(run)
    true = Model(scene.surfels, scene.environment.log())
    return probe_relighting(true, light, torch.ones(3), run, offset=OFFSET)


def bounces_needed(findings: Findings, decay: Decay) -> int:
    """Number of surfaces that light has to be followed over, by the measured loss with one bounce alone."""
    record = next(each for each in findings.evidence if each.effect == "bounces")
    if record.measured is None:
        return BOUNCES
    # dB back to squared errors, in units of the method's own.
    losses = record.measured.bound, findings.tolerance.decibel / 2
    first, tolerated = (10 ** (decibel / 10) - 1 for decibel in losses)
    return decay.needed(first, tolerated)


def report(scene: ProbeScene, findings: Findings, effects: tuple[str, ...], bounces: int | None = None) -> Probe:
    """The findings as plain data, with images of the change of the first view without each of ``effects``."""
    full, differences = difference_maps(scene, effects)
    photograph = scene.views[0].target
    return Probe(
        tolerance=findings.tolerance.decibel,
        mse=findings.tolerance.mse,
        records=tuple(EffectRecord(**each.plain()) for each in findings.evidence),
        plan=findings.plan.state(),
        bounces=bounces,
        reference=(full if photograph is None else photograph).cpu(),
        pictured=photograph is not None,
        differences={effect: change.cpu() for effect, change in differences.items()},
    )


def difference_maps(
    scene: ProbeScene, effects: Sequence[str]
) -> tuple[Float[Tensor, "height width 3"], dict[str, Float[Tensor, "height width"]]]:
    """The first view with all effects on, and the absolute change of each pixel without each effect.

    Both are in display sRGB on black; changes are means over channels.
    """
    radiance = PlanRadiance(replace(scene, views=scene.views[:1]))
    plans = {effect: plan_without(effect) for effect in effects}
    sent = {"shaded": radiance.shaded(EffectPlan()), "own": radiance.own(HIGHEST_DEGREE)}
    for effect, plan in plans.items():
        own = plan.sh_degree < HIGHEST_DEGREE
        sent[effect] = radiance.own(plan.sh_degree) if own else radiance.shaded(plan)
    (rendered,) = rendered_views(radiance.projections, [value.detach() for value in sent.values()])
    images = dict(zip(sent, rendered.channels.split(3, -1), strict=True))
    covered = rendered.alpha > SOLID_ALPHA

    def encoded(linear: Tensor) -> Tensor:
        return displayed(linear, rendered.alpha, scene.straight)

    maps = {}
    for effect, plan in plans.items():
        full, less = images["own" if plan.sh_degree < HIGHEST_DEGREE else "shaded"], images[effect]
        if light_factor_is_free(effect, scene):
            less = less * light_factor(less[covered], full[covered])
        maps[effect] = (encoded(less) - encoded(full)).abs().mean(-1)
    return encoded(images["shaded"]), maps


@torch.no_grad()
def solve_radiosity(surfels: Surfels, light: EnvironmentMap, samples: int, seed: int) -> tuple[Surfels, Decay]:
    """The surfels with their outgoing radiance under a light, the same in all directions, and its decay.

    ``samples``: directions of each surfel.
    """
    normal = surfels.frame[..., 2]
    direction, weight = hemisphere_directions(normal, samples, torch.Generator().manual_seed(seed))
    hits = SurfelTracer(surfels, OFFSET).trace(torch.arange(len(surfels)), direction, torch.zeros_like(surfels.albedo))
    lit = Incident(direction, weight, visibility_of(hits)[0].view(weight.shape), torch.zeros_like(direction))
    parts = shade_surfels(surfels, surfels.albedo, lit, normal[:, None], light.radiance)[:, 0]
    sent = parts[:, DIFFUSE_DIRECT] + parts[:, SPECULAR_DIRECT]
    total, decay = scatter(surfels, sent, direction, weight, BOUNCES - 1)
    return glowing(surfels, total), decay


@torch.no_grad()
def scatter(
    surfels: Surfels,
    sent: Float[Tensor, "surfels 3"],
    direction: Float[Tensor, "surfels samples 3"],
    weight: Float[Tensor, "surfels samples"],
    times: int,
) -> tuple[Float[Tensor, "surfels 3"], Decay]:
    """Outgoing radiance with up to ``times`` further bounces of the radiance ``sent``, linear RGB, and their energies.

    Solves radiosity by Jacobi's iteration over traced rays; surfaces scatter by Lambert's law. ``weight``: solid angles
    of the unit directions.
    """
    tracer, index = SurfelTracer(surfels, OFFSET), torch.arange(len(surfels))
    flow = (direction * surfels.frame[:, None, :, 2]).sum(-1, keepdim=True) * weight[..., None] / torch.pi
    total, energy = sent.clone(), []
    for _ in range(times):
        hits = tracer.trace(index, direction, sent)
        arriving = (hits.features * visibility_of(hits)[1][:, None]).view(direction.shape)
        sent = surfels.albedo * (flow * arriving).sum(1)
        energy.append(float(sent.mean()))
        total = total + sent
    return total, Decay(tuple(energy))
