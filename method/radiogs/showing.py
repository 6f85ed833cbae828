"""A trained RadioGS model for the harness, under the light of training or relit, and the labels of its settings.

Training never imports this module, so that a new map does not invalidate trained models.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import STANDARD_MAPS, MapKind, Maps, Prepared, Run
from radiogs_core.learning.geometry import turning
from radiogs_core.on_surfels.trained import ARRIVING, SHOWN_WITH_INCIDENT, Shown, TrainedOnSurfels
from radiogs_core.plain_values import leaf_names, value_at, with_values
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.maps import incident_maps, shaded_maps, split_sum_maps
from radiogs_core.transport.plan import plan_of
from radiogs_core.transport.prefiltered_light import PrefilteredLight
from radiogs_core.transport.sampling import relighting_directions
from radiogs_core.transport.tracer import gather_incident, incident_along

from .constants import as_text
from .effects.new_light import probe_relighting
from .model import Model
from .rays import RaySettings
from .recipes import PUBLISHED, RECIPES
from .relighting import RelitBySurfels, relight
from .settings import PATH, PRESETS, Budget, Variant
from .varying import VaryingRadioGS

SHOWN_BY_SURFELS: dict[str, MapKind] = {name: STANDARD_MAPS[name] for name in ("image", "alpha")}
"""Maps of a model that is rendered from its surfels' own radiance."""

DENSER = 2
"""Factor of training's number of directions over the hemisphere; as many are drawn from the light. In training a
surfel's directions change from step to step and the error of a set averages out; a view is shaded from one set."""

OTHER_SEED = 1_000_003
"""Added to the run's seed for the reference of relighting, so that it shares no random number with a mode."""


class TrainedRadioGS(TrainedOnSurfels[Model, Variant, Budget]):
    """Surfels with materials and a light, and the run that trained them; see ``contract.Trained``."""

    def __init__(self, model: Model, run: Run[Variant, Budget]) -> None:
        labels = labels_of(run.variant, run.budget, run.scene.layout, run.scene.name)
        super().__init__(model, run, labels)

    def facts(self) -> dict[str, Any]:
        """Facts for the result.

        ``surfels``: their number. ``effects``: the plan at the end of training, and its evidence, oldest first.
        ``metrics``: ``plan/bound`` and ``plan/worst``, upper bounds on the loss by the plan, dB of PSNR, of the probe
        with the largest; 0 if no probe left an effect out. ``labels``: differences from the paper, by name
        (``labels_of``). ``remarks``: effects that are not simulated, or why all are, the recipe and the length.
        ``given``: the parts of the truth that training was given, and the residual of the given indirect light
        (``KnownRadiance``).
        """
        plan, evidence = self.model.plan, [dict(each) for each in self.model.evidence]
        measured = [each["measured"] for each in evidence if each["effect"] == "plan" and each["measured"] is not None]
        indirect, parts = self.model.indirect, list(self.run.variant.given)
        residual = {} if indirect is None else {"indirect_residual": indirect.residual}
        return {
            **({"given": {"parts": parts, **residual}} if parts else {}),
            "surfels": len(self.model.surfels),
            "effects": {"plan": plan.state(), "evidence": evidence},
            "metrics": {
                f"plan/{name}": max((each[name] for each in measured), default=0.0) for name in ("bound", "worst")
            },
            "labels": self.labels,
            "remarks": [
                *([f"not simulated: {', '.join(plan.off)}"] if plan.off else []),
                *(f"all effects are simulated, {each['why']}" for each in evidence[-1:] if each["measured"] is None),
                *(f"{name}: {value}" for name, value in self.labels.items() if name in ("recipe", "length", "start")),
            ],
        }

    def as_trained(self) -> Prepared:
        """The model under its recovered light, shaded as in training, along more directions."""
        own = self.renderer()
        return Shown(own, STANDARD_MAPS if own.incident is None else SHOWN_WITH_INCIDENT)

    def renderer(self) -> "Renderer":
        """The renderer of the model under its recovered light."""
        return Renderer(self.model, self.run.budget.incident_samples, self.run.variant)

    def relit(
        self, light: EnvironmentMap, albedo_scale: Float[Tensor, "3"], after_step: Callable[[], None]
    ) -> Prepared:
        """The model under another light, in the variant's mode; with effects "auto", a probe decides the plan."""
        variant = self.run.variant
        remarks: tuple[str, ...] = ()
        if variant.effects == "auto":
            _, findings = probe_relighting(self.model, light, albedo_scale, self.run)
            plan = findings.plan
            remarks = tuple(f"{each.effect}: {each.verdict} ({each.why})" for each in findings.evidence)
        else:
            plan = plan_of(variant.effects)
        relit = relight(self.model, light, albedo_scale, self.run, after_step, plan)
        return Shown(relit, SHOWN_BY_SURFELS if isinstance(relit, RelitBySurfels) else STANDARD_MAPS, remarks)

    def reference(
        self, light: EnvironmentMap, albedo_scale: Float[Tensor, "3"], after_step: Callable[[], None]
    ) -> Prepared:
        """The path-traced model under another light; see ``radiogs_core.capabilities.RelitByReference``."""
        variant = replace(self.run.variant, relighting=PATH)
        run = replace(self.run, variant=variant, seed=self.run.seed + OTHER_SEED)
        return Shown(relight(self.model, light, albedo_scale, run, after_step), STANDARD_MAPS)

    def varying(self, cameras: Sequence[Camera]) -> VaryingRadioGS:
        """The model with changed roughness or brightness; see ``radiogs_core.capabilities.Variable``."""
        own = self.renderer()
        return VaryingRadioGS(self.model, own.incident, cameras, self.run.variant)


class Renderer:
    """A trained model under its recovered light, ready for rendering from any camera.

    For Monte-Carlo shading, incident light is traced once, along ``DENSER`` times ``samples`` directions over the
    hemisphere of each surfel and as many drawn from the light, weighted by the balance heuristic. A few directions over
    the hemisphere miss a sun, and without random rotation all surfels of a wall miss it in the same way. With the
    deviation ``spread-views`` there are ``samples`` directions over the hemisphere alone, not rotated. Effects that the
    model's plan leaves out are not simulated; surfels that kept their light in training are traced like all others.
    Given indirect light is used as in training. Two renderers of one model have the same directions.
    """

    def __init__(self, model: Model, samples: int, variant: Variant) -> None:
        self.model, self.straight, self.masking = model, variant.straight, variant.masking
        self.incident = None if variant.shading == "split-sum" else _incident(model, samples, variant)

    def render(self, camera: Camera, *further: str) -> Maps:
        """The maps of one view; see ``radiogs_core.on_surfels.trained.Renderer``."""
        surfels, environment = self.model.surfels, self.model.environment
        if self.incident is None:
            return split_sum_maps(camera, surfels, PrefilteredLight(environment, self.masking), self.straight)
        specular_at = self.model.plan.specular_among(surfels.albedo)
        maps = shaded_maps(camera, surfels, surfels.albedo, self.incident, environment, specular_at, self.straight)
        if set(ARRIVING).isdisjoint(further):
            return maps
        return maps | incident_maps(camera, surfels, self.incident, environment)


TOPICS: Mapping[str, tuple[str, ...]] = {
    "stage 1": ("geometry", "split_sum"),
    "stage 2": ("materials", "deviations"),
    "light and rays": ("masking", "ray_offset", "relighting", "met_light", "finetuning"),
}
"""Labels of settings by the first part of their names."""


def labels_of(variant: Variant, budget: Budget, layout: str, scene: str) -> dict[str, str]:
    """The recipe nearest to a run, its length beside the paper's, and settings that are not as printed, by name.

    ``layout`` and ``scene``: of the scene, for its recipe's values.
    """
    made = {name: with_values(Variant(), recipe.of(layout, scene)) for name, recipe in RECIPES.items()}
    apart = {name: differences(variant, recipe) for name, recipe in made.items()}
    name = min(apart, key=lambda each: len(apart[each]))
    by_label = "geometry.start.splat"  # its fields have a label of their own, without the file's path
    own = ", ".join(f"{field} = {value}" for field, (value, _) in apart[name].items() if not field.startswith(by_label))
    labels = {"recipe": f"{name}, {RECIPES[name].title}{', but for ' if own else ''}{own}"}
    labels |= length_label(variant, budget)
    unlike = differences(made[name], made[PUBLISHED])
    for topic, firsts in TOPICS.items():
        found = [
            f"{field.partition('.')[2] or field} {value} (printed: {theirs})"
            for field, (value, theirs) in unlike.items()
            if field.partition(".")[0] in firsts
        ]
        if found:
            labels[f"{topic}, not as printed"] = ", ".join(found)
    return labels


def differences(variant: Variant, other: Variant) -> dict[str, tuple[str, str]]:
    """The fields in which two variants differ, with both values as text."""
    return {
        name: (as_text(value_at(variant, name)), as_text(value_at(other, name)))
        for name in leaf_names(variant)
        if value_at(variant, name) != value_at(other, name)
    }


def length_label(variant: Variant, budget: Budget) -> dict[str, str]:
    """The label ``length``: the steps beside the paper's, and the factors of rates that follow; empty at its length."""
    paper = PRESETS["paper"]
    stages = (budget.geometry.steps, budget.inverse_iterations)
    whole = (paper.geometry.steps, paper.inverse_iterations)
    if stages == whole:
        return {}
    factor = variant.materials.rates.factor(budget.inverse_iterations)
    return {
        "length": f"{stages[0]:,} + {stages[1]:,} steps (paper: {whole[0]:,} + {whole[1]:,}); schedules are shares of"
        f" a stage; the length rule takes rates of positions times {budget.geometry.rate:.3g} and of rotations times"
        f" {turning(budget.geometry.rate):.3g} in stage 1, of materials, light and harmonics times {factor:.3g} in"
        f" stage 2; N_g {budget.consistency_surfels:,} (paper: {paper.consistency_surfels:,}), N_s"
        f" {budget.incident_samples} (paper: {paper.incident_samples})"
    }


@torch.no_grad()
def _incident(model: Model, samples: int, variant: Variant) -> Incident:
    """The incident light on each surfel along the directions from which views are shaded (see ``Renderer``)."""
    rays, surfels, plan = RaySettings.of(variant, model.indirect), model.surfels, model.plan.at_once
    tracer = rays.tracer(surfels)
    if "spread-views" in variant.deviations:
        return gather_incident(tracer, surfels, samples, None, rays.floor, plan)
    generator = torch.Generator(surfels.centre.device).manual_seed(0)
    light = LightSampler(EnvironmentMap(model.environment))
    each = DENSER * samples
    directions = relighting_directions(surfels.frame[..., 2], light, each, each, generator, rays.floor)
    return incident_along(tracer, *directions, plan)
