"""Which effects RadioGS needs on a scene as it truly is, or for a trained model: in training, or relit by a light."""

from dataclasses import replace

import torch

from radiogs_core.capabilities import EffectRecord, Probe
from radiogs_core.contract import Run
from radiogs_core.errors import DataError
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene
from radiogs_core.surfels.known_surfaces import surfels_on
from radiogs_core.surfels.surfels import Surfels

from .budget import Budget
from .effects.difference_maps import difference_maps
from .effects.evidence import Evidence
from .effects.new_light import IN_RELIGHTING, decide_light_sampling
from .effects.probe import Findings, Occasion, probe
from .effects.probe_scene import ProbeRays, ProbeScene, trace_scene
from .effects.radiosity import BOUNCES, OFFSET, Decay, solved
from .effects.step_cost import Step
from .model import Model
from .relighting import probe_relighting, training_viewpoints
from .tracing import Rays

EFFECTS = ("visibility", "indirect", "bounces", "specular", "samples")
"""Effects that a probe of a scene measures: view-dependence is none, as true surfels are given the same radiance in all
directions."""

EFFECTS_OF_MODELS = (*EFFECTS, "view-dependence")
"""Effects that a probe of a trained model measures."""

SPACING = 0.08
"""World units between the surfels that are laid on a scene's true surfaces; generated scenes are 2 to 3 across."""


def probed(run: Run, model: Model | None, light: EnvironmentMap | None) -> Probe:
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


def probe_scene(run: Run) -> tuple[ProbeScene, Decay]:
    """The run's scene by its true surfaces and light, and how light decays in it. Raises DataError (``true_model``)."""
    samples, (surfels, light) = run.budget.incident_samples, true_model(run.scene)
    surfels, decay = solved(surfels, light, samples, run.seed)
    rays = ProbeRays(samples, torch.Generator().manual_seed(run.seed), Rays.of(run.variant), OFFSET)
    return trace_scene(surfels, light.radiance, training_viewpoints(run, surfels), rays, bounces=True), decay


def probe_scene_of_model(run: Run, model: Model) -> ProbeScene:
    """A trained model of the run's scene, under the light that it has recovered."""
    surfels = model.surfels
    generator = torch.Generator(surfels.centre.device).manual_seed(run.seed)
    rays = ProbeRays(run.budget.incident_samples, generator, Rays.of(run.variant))
    return trace_scene(surfels, model.environment, training_viewpoints(run, surfels), rays, bounces=True)


def findings_of(scene: ProbeScene, run: Run, effects: tuple[str, ...] = EFFECTS) -> Findings:
    """What stage 2 with the run's budget would leave out."""
    budget: Budget = run.budget
    step = Step(len(scene.surfels), budget.consistency_surfels, budget.incident_samples, budget.refresh_interval)
    return probe(scene, step, Occasion(run.seed), effects=effects)


def findings_under(run: Run, model: Model | None, light: EnvironmentMap) -> tuple[ProbeScene, Findings]:
    """What relighting by ``light`` would leave out, and the scene that was probed; without a model, the true one."""
    if model is not None:
        return probe_relighting(model, light, torch.ones(3), run)
    scene, _ = probe_scene(run)
    true = Model(scene.surfels, scene.environment.log())
    return probe_relighting(true, light, torch.ones(3), run, offset=OFFSET)


def sampling_of(run: Run, scene: ProbeScene, found: Findings) -> Evidence:
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
