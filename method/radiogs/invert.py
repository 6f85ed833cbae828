"""Stage 2, inverse rendering: materials and light under Monte-Carlo radiometric consistency (paper, Eq. 11).

It starts with the surfels and radiance of stage 1, new materials and a new light (``start``).
"""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import torch
from torch import Tensor

from radiogs_core.contract import Run
from radiogs_core.kernels.image.terms import Aim, Blended, Compared, Terms, image_terms
from radiogs_core.learning.losses import counted, crossed, edge_weights, environment_smoothness, light_prior
from radiogs_core.learning.views import TrainingView
from radiogs_core.on_surfels.stage import SurfelStage
from radiogs_core.surfels.optimiser import SurfelOptimiser
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.plan import HIGHEST_DEGREE, EffectPlan, plan_of
from radiogs_core.transport.prefiltered_light import PrefilteredLight
from radiogs_core.transport.splatting import own_radiance, splat, towards

from .consistency import RadiometricConsistency
from .incident_cache import IncidentCache
from .model import Model
from .oracle import Start, with_given_parts
from .rays import RaySettings
from .settings import Budget, Variant
from .shaders import MonteCarlo, Shader, SplitSum


class Planning(Protocol):
    """Decides during stage 2 which effects it simulates, by evidence."""

    plan: EffectPlan
    """The present plan."""

    def begin_step(self, stage: "InverseRendering") -> None:
        """Decide anew if that is due before the stage's next step; ``IncidentCache.adopt`` takes another plan."""

    @property
    def records(self) -> tuple[Mapping[str, Any], ...]:
        """All decisions until now, as plain values."""

    def state(self) -> dict[str, Any]:
        """Tensors and plain values from which ``restore`` continues bit for bit."""

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""


class InverseRendering(SurfelStage[Variant, Budget]):
    """Stage 2. It keeps the geometry and radiance of stage 1, and starts with new materials and a new light."""

    cache: IncidentCache
    """The cached light; split-sum shading has none."""

    def __init__(self, run: Run[Variant, Budget], made: Mapping[str, Any], planning: Planning | None = None) -> None:
        """``made``: what ``start.make_start`` returned. The stage goes on with the random numbers of its generator.

        ``planning``: decides about effects; None: the variant's effects.
        """
        variant = run.variant
        super().__init__(run, run.budget.inverse_iterations, variant.view_share)
        self.planning = planning
        self.generator.set_state(made["generator"])
        self.geometry, self.surrounded = variant.surfel_learning, run.scene.surrounded
        self.start = start_of(run, made)
        light = {"log_environment": self.start.log_environment}
        self.optimiser = SurfelOptimiser(self.start.surfels, light, self.start.rates)
        self.shaded_weight = 1.0 if "image-weight" in variant.deviations else variant.materials.weights.absolute
        self.shader = self.make_shader()

    def make_shader(self) -> Shader:
        """The shader of L_PBR that the variant selects."""
        if self.variant.shading == "split-sum":
            return SplitSum(self.variant.masking)
        rays = RaySettings.of(self.variant, self.start.indirect)
        self.cache = IncidentCache(self.model, rays, self.variant, self.budget, self.generator, self.plan)
        return MonteCarlo(RadiometricConsistency.of(self.variant), self.cache)

    @property
    def plan(self) -> EffectPlan:
        """The effects that are simulated at present."""
        return plan_of(self.variant.effects) if self.planning is None else self.planning.plan

    @property
    def model(self) -> Model:
        """The present surfels and light, and the plan of effects with its evidence."""
        records = () if self.planning is None else self.planning.records
        light = self.optimiser.tensors["log_environment"]
        return Model(self.optimiser.surfels, light, self.plan, records, self.start.indirect)

    def visible_model(self) -> Model:
        """The model for the losses of a step, with gradient to all learnt tensors."""
        surfels, degree = self.optimiser.surfels.with_cached_values(), self.plan.sh_degree
        if degree < HIGHEST_DEGREE:
            surfels.sh = surfels.sh[:, : (degree + 1) ** 2]
        return Model(surfels, self.optimiser.tensors["log_environment"])

    def begin_step(self) -> None:
        """Decide about effects, if that is due."""
        if self.planning is not None:
            self.planning.begin_step(self)

    def losses(self, view: TrainingView) -> dict[str, Tensor]:
        """The weighted losses of the next step, on ``view``, by name (paper, Eq. 11)."""
        model = self.visible_model()
        return {"consistency": self.consistency_loss(model, view), **self.image_losses(model, view)}

    def consistency_loss(self, model: Model, view: TrainingView) -> Tensor:
        """Weighted L_rad. With weight 0 it has no gradient, but the traced light is still cached."""
        weight = self.variant.radiometric_weight
        with torch.set_grad_enabled(weight > 0):
            return weight * self.shader.consistency(model, view.camera, self.iteration)

    def image_losses(self, model: Model, view: TrainingView) -> dict[str, Tensor]:
        """The weighted losses of the blended images, of the maps and of the light, by name."""
        surfels, camera = model.surfels, view.camera
        outgoing = towards(camera, surfels)
        light = PrefilteredLight(model.environment, self.variant.masking)
        sets = self.shader.radiance(model, outgoing, light).unbind(1)
        shaded = {f"shaded {number}": each for number, each in enumerate(sets, 1)}
        channels = {
            "radiance": own_radiance(camera, surfels),
            **shaded,
            "albedo": surfels.albedo,
            "roughness": surfels.roughness[:, None],
        }
        seen = splat(camera, surfels, channels, self.depth_unit)
        images, terms, geometry = seen.images, self._terms(list(shaded)), self.geometry
        allowance = edge_weights(view, geometry.edge_sharpness, geometry.across_silhouettes)
        aim = Aim(view.over(terms.background), view.mask, allowance)
        blended = Blended(seen.alpha, seen.normal, seen.depth, seen.distortion)
        by_sets = [images[name] for name in shaded]
        compared = [images["radiance"], *(crossed(*by_sets) if len(by_sets) == 2 else by_sets)]
        aim, blended, shown = counted(view, terms.background, aim, blended, compared)
        losses = image_terms(terms, camera, aim, blended, shown, [images["albedo"], images["roughness"]])
        if by_set := [losses.pop(name) for name in shaded if name in losses]:
            losses["shaded"] = torch.stack(by_set).sum()
        return {**losses, **self._light_losses(model, light)}

    def _light_losses(self, model: Model, light: PrefilteredLight) -> dict[str, Tensor]:
        """The weighted losses of a learnt light; none for a light that is held, to which they have no gradient."""
        if not model.log_environment.requires_grad:
            return {}
        weights, normal = self.variant.materials.weights, model.surfels.frame[..., 2].detach()
        return {
            "light prior": weights.light_prior * light_prior(light.irradiance(normal)),
            "light smoothness": weights.light_smoothness * environment_smoothness(model.environment),
        }

    def _terms(self, shaded: Sequence[str]) -> Terms:
        """The losses of this step's images and maps. ``shaded``: names of the images of L_PBR, which share a weight."""
        weights, geometry, sets = self.variant.materials.weights, self.geometry, len(shaded)
        late = self.iteration >= self.variant.materials.normal_from * self.iterations
        return Terms(
            images=(
                Compared("radiance", weights.absolute, weights.similarity),
                *(
                    Compared(name, self.shaded_weight / sets, weights.similarity / sets, squared=weights.squared / sets)
                    for name in shaded
                ),
            ),
            encoding="straight" if self.variant.straight else "premultiplied",
            background=0.0,
            mask=weights.mask,
            normal=weights.normal if late else 0.0,
            one_sided=geometry.normal_target == "one-sided",
            distortion=weights.distortion,
            far=self.depth_unit if self.surrounded else 0.0,
            smoothness=(
                ("normal smoothness", weights.normal_smoothness),
                ("albedo smoothness", weights.albedo_smoothness),
                ("roughness smoothness", weights.roughness_smoothness),
            ),
            masked=True,
        )

    def state(self) -> dict[str, Any]:
        """Tensors and plain values from which ``restore`` continues bit for bit."""
        planning = {} if self.planning is None else {"planning": self.planning.state()}
        return super().state() | {"shader": self.shader.state()} | planning

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        super().restore(state)
        self.shader.restore(state["shader"])
        if self.planning is not None:
            self.planning.restore(state["planning"])
            self.cache.plan = self.planning.plan


def start_of(run: Run[Variant, Budget], made: Mapping[str, Any]) -> Start:
    """The start of stage 2: new materials, a new light, and the given parts of the truth.

    ``made``: what ``start.make_start`` returned. Raises DataError if the truth of a given part is not known.
    """
    scene, variant = run.scene, run.variant
    rates = rates_of(variant, scene.extent, run.budget.inverse_iterations, made["searched"])
    start = Start(Surfels.of(made["surfels"]), made["log_environment"], rates)
    return with_given_parts(start, variant.given, scene, run.seed)


def rates_of(variant: Variant, extent: float, steps: int, searched: bool = True) -> dict[str, float]:
    """Learning rates of stage 2 by raw parameter.

    ``extent``: extent of the scene, world units. ``steps``: number of steps of the stage, for the length rule.
    ``searched``: whether the light was searched for. With given geometry, surfels have not been through stage 1: their
    scales and opacities are learnt at its rates.
    """
    rates, before = variant.materials.rates, variant.geometry.rates
    share = 1.0 if "geometry" in variant.given else rates.geometry
    longer = rates.factor(steps)
    return {
        "centre": rates.geometry * (before.position * extent),
        "rotation": rates.geometry * before.rotation,
        "log_scale": share * before.scale,
        "opacity_logit": share * before.opacity,
        "sh": longer * rates.radiance,
        "sh_rest": longer * rates.radiance_rest,
        "albedo_logit": longer * rates.albedo,
        "roughness_logit": rates.roughness_in(steps),
        "log_environment": longer * (rates.light if searched else rates.constant_light),
    }
