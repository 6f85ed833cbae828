"""Which effects RadioGS needs on a scene as it truly is, or for a trained model: in training, or relit by a light.

A probe of the true scene follows light over its surfels bounce by bounce (``solved``), and says how much each further
one adds. ``difference_maps`` shows where effects matter.
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
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene
from radiogs_core.surfels.known_surfaces import surfels_on
from radiogs_core.surfels.surfels import Surfels, radiance_to_sh
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.plan import HIGHEST_DEGREE, EffectPlan
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_core.transport.splatting import DIFFUSE_DIRECT, SOLID_ALPHA, SPECULAR_DIRECT, shade_surfels
from radiogs_core.transport.tracer import SurfelTracer, visibility_of

from ..model import Model
from ..rays import RaySettings
from ..settings import Budget, Variant
from .assessment import light_factor_is_free
from .covered_pixels import rendered_views
from .evidence import Evidence
from .new_light import IN_RELIGHTING, decide_light_sampling, probe_relighting, training_viewpoints
from .plan_radiance import PlanRadiance
from .probe import Findings, Occasion, probe
from .probe_scene import ProbeRays, ProbeScene, trace_scene
from .step_cost import Step
from .substitutes import plan_without
from .tile_errors import light_factor

OFFSET = 0.1
"""Where rays start, in standard deviations: on surfels that lie exactly on their surface little more than rounding is
in the way."""

BOUNCES = 8
"""Surfaces that light is followed over, as in the pictures of generated scenes."""


@dataclass(frozen=True)
class Decay:
    """Energy that arrives after one surface, after two, and so on: means over surfels and channels, linear."""

    energy: tuple[float, ...]

    @property
    def ratio(self) -> float:
        """Of the second to the first; 0 where nothing arrives."""
        return self.energy[1] / self.energy[0] if self.energy[0] > 0 else 0.0

    def needed(self, first: float, tolerated: float) -> int:
        """Bounces after which what is missing costs less than is tolerated; ``first``: what all but one of them add.

        Both are squared errors, which fall by the square of the ratio with every further bounce.
        """
        if first <= tolerated or self.ratio <= 0:
            return 1
        falling = math.log(min(self.ratio, 0.99) ** 2)
        return 1 + math.ceil(math.log(tolerated / first) / falling)


EFFECTS = ("visibility", "indirect", "bounces", "specular", "samples")
"""Effects that a probe of a scene measures: view-dependence is none, as true surfels are given the same radiance in all
directions."""

EFFECTS_OF_MODELS = (*EFFECTS, "view-dependence")
"""Effects that a probe of a trained model measures."""

SPACING = 0.08
"""World units between the surfels that are laid on a scene's true surfaces; generated scenes are 2 to 3 across."""


def probed(run: Run[Variant, Budget], model: Model | None, light: EnvironmentMap | None) -> Probe:
    """What stage 2 with the run's budget needs, or relighting by ``light``: on the run's scene, or for a trained model.

    Without a model, the scene is probed as it truly is. Raises DataError (see ``true_model``).
    """
    if light is not None:
        return shown(*findings_under(run, model, light), IN_RELIGHTING)
    if model is not None:
        scene = probe_scene_of_model(run, model)
        return shown(scene, findings_of(scene, run, EFFECTS_OF_MODELS), EFFECTS_OF_MODELS)
    scene, decay = probe_scene(run)
    found = findings_of(scene, run)
    found = with_record(found, sampling_of(run, scene, found))
    return shown(scene, found, EFFECTS, bounces_needed(found, decay))


def true_model(scene: Scene, spacing: float = SPACING) -> tuple[Surfels, EnvironmentMap]:
    """Surfels on the true surfaces of a scene with their true materials, and its true light.

    Raises DataError where those are not known, and where surfaces emit light or have no specular lobe.
    """
    samples = None if scene.surfaces is None else scene.true_surfaces(spacing)
    # A probe lights surfels by the environment alone, and gives all of them a lobe.
    if samples is None or samples.emission is not None or not samples.specular or scene.training_light is None:
        raise DataError(
            f"scene '{scene.name}' has no known solids and light to be probed by",
            "Only the generated scenes do; of others only a trained model can be probed.",
            f"Train one, and probe its folder:  radiogs-bench train {scene.name} --out DIR",
        )
    return surfels_on(samples), scene.training_light


def probe_scene(run: Run[Variant, Budget]) -> tuple[ProbeScene, Decay]:
    """The run's scene by its true surfaces and light, and how light decays in it. Raises DataError (``true_model``)."""
    samples, (surfels, light) = run.budget.incident_samples, true_model(run.scene)
    surfels, decay = solved(surfels, light, samples, run.seed)
    rays = ProbeRays(samples, torch.Generator().manual_seed(run.seed), RaySettings.of(run.variant), OFFSET)
    return trace_scene(surfels, light.radiance, training_viewpoints(run, surfels), rays, bounces=True), decay


def probe_scene_of_model(run: Run[Variant, Budget], model: Model) -> ProbeScene:
    """A trained model of the run's scene, under the light that it has recovered."""
    surfels = model.surfels
    generator = torch.Generator(surfels.centre.device).manual_seed(run.seed)
    rays = ProbeRays(run.budget.incident_samples, generator, RaySettings.of(run.variant))
    return trace_scene(surfels, model.environment, training_viewpoints(run, surfels), rays, bounces=True)


def findings_of(scene: ProbeScene, run: Run[Variant, Budget], effects: tuple[str, ...] = EFFECTS) -> Findings:
    """What stage 2 with the run's budget would leave out."""
    budget = run.budget
    step = Step(len(scene.surfels), budget.consistency_surfels, budget.incident_samples, budget.refresh_interval)
    return probe(scene, step, Occasion(run.seed), effects=effects)


def findings_under(
    run: Run[Variant, Budget], model: Model | None, light: EnvironmentMap
) -> tuple[ProbeScene, Findings]:
    """What relighting by ``light`` would leave out, and the scene that was probed; without a model, the true one."""
    if model is not None:
        return probe_relighting(model, light, torch.ones(3), run)
    scene, _ = probe_scene(run)
    true = Model(scene.surfels, scene.environment.log())
    return probe_relighting(true, light, torch.ones(3), run, offset=OFFSET)


def sampling_of(run: Run[Variant, Budget], scene: ProbeScene, found: Findings) -> Evidence:
    """Whether relighting by the scene's own light needs directions that are drawn from it."""
    light, budget = run.scene.training_light, run.budget
    if light is None:
        raise DataError(f"the light of scene '{run.scene.name}' is not known", "There is nothing to draw from.")
    return decide_light_sampling(
        scene.surfels, light, found.tolerance,
        budget.relight_hemisphere_samples, budget.relight_light_samples, run.seed,
    )  # fmt: skip


def with_record(found: Findings, record: Evidence) -> Findings:
    """The findings with one more record, of light sampling."""
    plan = replace(found.plan, light_sampling=record.verdict == "on")
    return replace(found, plan=plan, evidence=(*found.evidence, record))


def bounces_needed(found: Findings, decay: Decay) -> int:
    """How many surfaces light has to be followed over, from what leaving out all but the first costs."""
    record = next(each for each in found.evidence if each.effect == "bounces")
    if record.measured is None:
        return BOUNCES
    # dB back to squared errors, in units of the method's own.
    first, tolerated = (10 ** (decibel / 10) - 1 for decibel in (record.measured.bound, found.tolerance.decibel / 2))
    return decay.needed(first, tolerated)


def shown(scene: ProbeScene, found: Findings, effects: tuple[str, ...], bounces: int | None = None) -> Probe:
    """Findings as plain data, with images of what leaving out each of ``effects`` changes in the first view."""
    full, differences = difference_maps(scene, effects)
    taken = scene.views[0].target
    return Probe(
        tolerance=found.tolerance.decibel,
        mse=found.tolerance.mse,
        records=tuple(EffectRecord(**each.plain()) for each in found.evidence),
        plan=found.plan.plain(),
        bounces=bounces,
        reference=(full if taken is None else taken).cpu(),
        pictured=taken is not None,
        differences={effect: change.cpu() for effect, change in differences.items()},
    )


def difference_maps(
    scene: ProbeScene, effects: Sequence[str]
) -> tuple[Float[Tensor, "height width 3"], dict[str, Float[Tensor, "height width"]]]:
    """The first view with everything on, and how much leaving each effect out changes each pixel, mean over channels.

    Both in display sRGB.
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
def solved(
    surfels: Surfels, light: EnvironmentMap, samples: int, seed: int, bounces: int = BOUNCES
) -> tuple[Surfels, Decay]:
    """The surfels with the radiance that they send out under a light, the same to all sides, and how it builds up."""
    normal = surfels.frame[..., 2]
    direction, weight = hemisphere_directions(normal, samples, torch.Generator().manual_seed(seed))
    hits = SurfelTracer(surfels, OFFSET).trace(torch.arange(len(surfels)), direction, torch.zeros_like(surfels.albedo))
    lit = Incident(direction, weight, visibility_of(hits)[0].view(weight.shape), torch.zeros_like(direction))
    parts = shade_surfels(surfels, surfels.albedo, lit, normal[:, None], light.radiance)[:, 0]
    sent = parts[:, DIFFUSE_DIRECT] + parts[:, SPECULAR_DIRECT]
    total, decay = scattered(surfels, sent, direction, weight, bounces - 1)
    harmonics = torch.cat([radiance_to_sh(total)[:, None], torch.zeros_like(surfels.sh[:, 1:])], 1)
    return Surfels.of(surfels.parameters() | {"sh": harmonics}), decay


@torch.no_grad()
def scattered(
    surfels: Surfels,
    sent: Float[Tensor, "surfels 3"],
    direction: Float[Tensor, "surfels samples 3"],
    weight: Float[Tensor, "surfels samples"],
    times: int,
) -> tuple[Float[Tensor, "surfels 3"], Decay]:
    """Radiance after what is ``sent`` was scattered that many times, and the energy of each.

    Radiosity by Jacobi's iteration over traced rays; surfaces scatter by Lambert's law.
    """
    tracer, index = SurfelTracer(surfels, OFFSET), torch.arange(len(surfels))
    flow = (direction * surfels.frame[:, None, :, 2]).sum(-1, keepdim=True) * weight[..., None] / torch.pi
    total, energy = sent.clone(), []
    for _ in range(times):
        hits = tracer.trace(index, direction, sent)
        met = (hits.features * visibility_of(hits)[1][:, None]).view(direction.shape)
        sent = surfels.albedo * (flow * met).sum(1)
        energy.append(float(sent.mean()))
        total = total + sent
    return total, Decay(tuple(energy))
