"""Probes of scenes and of trained models: what training calls for, and what relighting by a light does."""

import math
from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs.budget import Budget
from radiogs.effects.decide.evidence import Evidence
from radiogs.effects.decide.planner import SIGHTS
from radiogs.effects.decide.probe import Findings, probe
from radiogs.effects.decide.relighting import (
    IN_RELIGHTING,
    own_error,
    plan_for_light,
    settle_light_sampling,
    subject_under,
)
from radiogs.effects.measure.prices import Step
from radiogs.effects.measure.share import image_share
from radiogs.effects.measure.subject import Sight, Subject, subject_of
from radiogs.model import Model
from radiogs_core.errors import DataError
from radiogs_core.learning.views import load
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene
from radiogs_core.surfels.known_surfaces import surfels_on
from radiogs_core.surfels.surfels import Surfels, radiance_to_sh
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_core.transport.splatting import DIFFUSE_DIRECT, SPECULAR_DIRECT, shade_surfels
from radiogs_core.transport.tracer import SELF_OFFSET, SurfelTracer, visibility_of

EFFECTS = ("visibility", "indirect", "bounces", "specular", "samples")
"""What a probe of a scene looks at: the radiance that its surfels are given is the same to all sides."""

EFFECTS_OF_MODELS = (*EFFECTS, "view-dependence")
"""What a probe of a trained model looks at."""

SPACING = 0.08
"""World units between the surfels that are laid over a generated scene; the scenes are 2 to 3 across."""

OFFSET = 0.1
"""Where rays start on them, in standard deviations: such surfels lie exactly on their surface."""

BOUNCES = 8
"""Surfaces that light meets on the surfels of a generated scene, as in its pictures."""


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


def subject_of_scene(scene: Scene, samples: int, seed: int) -> tuple[Subject, Decay]:
    """The scene as surfels that are true to it, seen from its training views. Raises DataError (see ``true_model``)."""
    surfels, light = true_model(scene)
    surfels, decay = solved(surfels, light, samples, seed)
    sights = sights_of(scene, torch.device("cpu"))
    generator = torch.Generator().manual_seed(seed)
    share = share_of(scene, surfels)
    return subject_of(surfels, light.radiance, sights, share, samples, generator, bounces=True, offset=OFFSET), decay


def findings_of(subject: Subject, budget: Budget, seed: int, effects: tuple[str, ...] = EFFECTS) -> Findings:
    """What stage 2 with this budget would leave out of a subject."""
    step = Step(len(subject.surfels), budget.consistency_surfels, budget.incident_samples, budget.refresh_interval)
    return probe(subject, step, seed, effects=effects)


def sights_of(scene: Scene, device: torch.device, count: int = SIGHTS) -> tuple[Sight, ...]:
    """Training views, evenly spread over their list, with their images on black."""
    chosen = scene.train[:: max(1, len(scene.train) // count)][:count]
    return tuple(Sight(view.camera, view.over(0.0)) for view in load(chosen, device))


def share_of(scene: Scene, surfels: Surfels) -> Float[Tensor, " surfels"]:
    """The part of the training pictures that each surfel is."""
    return image_share((view.camera for view in scene.train), surfels)


def plan_under(
    model: Model,
    light: EnvironmentMap,
    albedo_scale: Float[Tensor, "3"],
    scene: Scene,
    share: Float[Tensor, " surfels"],
    budget: Budget,
    seed: int,
    device: torch.device,
    offset: float = SELF_OFFSET,
) -> tuple[Subject, Findings]:
    """What relighting a model by ``light`` may leave out, and what was looked at. ``share``: of ``share_of``."""
    surfels, sights = model.surfels, sights_of(scene, device)
    subject = subject_under(
        surfels, surfels.albedo.detach() * albedo_scale.to(device), EnvironmentMap(light.radiance.to(device)),
        sights, share, seed, offset,
    )  # fmt: skip
    directions = budget.relight_hemisphere_samples, budget.relight_light_samples
    return subject, plan_for_light(subject, own_error(surfels, sights), *directions, seed)


def subject_of_model(model: Model, scene: Scene, budget: Budget, seed: int) -> Subject:
    """A trained model, seen from training views of its scene."""
    surfels = model.surfels
    generator = torch.Generator(surfels.centre.device).manual_seed(seed)
    sights = sights_of(scene, surfels.centre.device)
    share = share_of(scene, surfels)
    return subject_of(surfels, model.environment, sights, share, budget.incident_samples, generator, bounces=True)


def sampling_of(scene: Scene, subject: Subject, found: Findings, budget: Budget, seed: int) -> Evidence:
    """Whether relighting by the scene's own light needs directions that are drawn from it."""
    if scene.training_light is None:
        raise DataError(f"the light of scene '{scene.name}' is not known", "There is nothing to draw from.")
    return settle_light_sampling(
        subject.surfels, scene.training_light, found.tolerance,
        budget.relight_hemisphere_samples, budget.relight_light_samples, seed,
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


def psnr_of(found: Findings) -> float:
    """PSNR of the method's own error, dB."""
    return -10 * math.log10(found.tolerance.mse) if found.tolerance.mse > 0 else math.inf


def record_of(found: Findings, bounces: int | None) -> dict[str, Any]:
    """Findings as plain values."""
    return {
        "mse": found.tolerance.mse,
        "tolerance": found.tolerance.decibel,
        "plan": found.plan.plain(),
        "bounces": bounces,
        "evidence": [each.plain() for each in found.evidence],
    }


@dataclass(frozen=True)
class Probed:
    """A probe as it is shown: what was looked at, what was found, and of which effects to draw a picture.

    bounces: how many are needed; None where that is not known.
    """

    subject: Subject
    found: Findings
    effects: tuple[str, ...]
    bounces: int | None = None


def probed_scene(scene: Scene, budget: Budget, seed: int, light: EnvironmentMap | None) -> Probed:
    """A generated scene under its own light, or relit by ``light``. Raises DataError (see ``true_model``)."""
    subject, decay = subject_of_scene(scene, budget.incident_samples, seed)
    if light is not None:
        model = Model(subject.surfels, subject.environment.log())
        share, device = share_of(scene, subject.surfels), torch.device("cpu")
        relit, found = plan_under(model, light, torch.ones(3), scene, share, budget, seed, device, OFFSET)
        return Probed(relit, found, IN_RELIGHTING)
    found = findings_of(subject, budget, seed)
    found = with_record(found, sampling_of(scene, subject, found, budget, seed))
    return Probed(subject, found, EFFECTS, bounces_needed(found, decay))


def probed_model(
    model: Model, scene: Scene, budget: Budget, seed: int, device: torch.device, light: EnvironmentMap | None
) -> Probed:
    """A trained model under the light that it has recovered, or relit by ``light``."""
    if light is not None:
        share = share_of(scene, model.surfels)
        return Probed(*plan_under(model, light, torch.ones(3), scene, share, budget, seed, device), IN_RELIGHTING)
    subject = subject_of_model(model, scene, budget, seed)
    return Probed(subject, findings_of(subject, budget, seed, EFFECTS_OF_MODELS), EFFECTS_OF_MODELS)
