"""Measuring what plans change in the full images of a scene, and deciding by what was measured.

``Gradients`` says how leaving an effect out changes the gradients: an effect that hardly changes images may carry the
only gradient.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.kernels.image.display import displayed
from radiogs_core.kernels.rasterize.rasterize import blend
from radiogs_core.transport.plan import HIGHEST_DEGREE, EffectPlan

from .bounds import Bootstrap, zero_events_upper
from .covered_pixels import CoveredPixels, rendered_views
from .decision import decide
from .evidence import Measured, Verdict
from .plan_radiance import PlanRadiance
from .probe_scene import ProbeScene
from .step_cost import Step, cost
from .substitutes import restricted_to
from .tile_errors import ReferenceImage, TileErrors, mean_error, tile_errors
from .tolerance import Tolerance

NOT_ABSORBED = ("view-dependence", "samples")
"""Effects whose absence no factor on the light compensates."""


def light_factor_is_free(effect: str, scene: ProbeScene) -> bool:
    """Whether a factor on the light may compensate what leaving an effect out does to all pixels alike."""
    return effect not in NOT_ABSORBED and not scene.given_light


class Assessment:
    """Measures plans against the images of a scene with everything on.

    ``level`` is the error of each bound. ``decibel`` are tolerated beside the method's own error ``mse``; None: that of
    the images, or of the surfels' own radiance where that is smaller, against the views' targets.
    """

    def __init__(
        self, scene: ProbeScene, step: Step, seed: int, level: float, decibel: float, mse: float | None
    ) -> None:
        self.scene, self.step, self.seed, self.mse = scene, step, seed, mse
        self.level = level
        self.bootstrap = Bootstrap(level, torch.Generator().manual_seed(seed))
        self.radiance = PlanRadiance(scene)
        self.gradients = Gradients(self.radiance)
        full = {
            "shaded": self.radiance.shaded(EffectPlan()).detach(),
            "own": self.radiance.own(HIGHEST_DEGREE),
        }
        if scene.sharpest is not None:
            full["sharp"] = self.radiance.shaded(EffectPlan(), sharp=True).detach()
        rendered = rendered_views(self.radiance.projections, full.values())
        self.pixels = CoveredPixels.of(scene.views, rendered, scene.straight)
        shown = zip(full, self.pixels.take(rendered), strict=True)
        self.full = {name: ReferenceImage.of(image, self.pixels) for name, image in shown}
        if mse is None:
            mse = min(mean_error(self.full[name], self.pixels) for name in ("shaded", "own"))
        self.tolerance = Tolerance(mse, decibel)

    def of(self, scene: ProbeScene, level: float) -> "Assessment":
        """An assessment with these settings for another scene, and bounds with another level of error."""
        return Assessment(scene, self.step, self.seed, level, self.tolerance.decibel, self.mse)

    def was_left_out(self, plan: EffectPlan, before: EffectPlan) -> bool:
        """Whether ``before`` left out as much already; a plan that leaves out more has to pass the stricter rule."""
        return bool(before.off) and self.step.saving(plan, EffectPlan()) <= self.step.saving(before, EffectPlan())

    def by_images(self, effect: str, plan: EffectPlan, measured: Measured, before: EffectPlan) -> tuple[Verdict, str]:
        """The rule without gradients. Hysteresis compares with what ``before`` left out of the same effect."""
        return decide(measured, self._was_off(effect, plan, before), self.tolerance.decibel)

    def decided(
        self, effect: str, plan: EffectPlan, measured: Measured, before: EffectPlan
    ) -> tuple[Verdict, str, Measured]:
        """The whole rule. Gradients cost most and come last: a plan that images refuse needs none."""
        verdict, why = self.by_images(effect, plan, measured, before)
        if verdict == "off" and replace(plan, sh_degree=HIGHEST_DEGREE).off:
            measured = replace(measured, gradient=self.gradients.change(plan))
            verdict, why = decide(measured, self._was_off(effect, plan, before), self.tolerance.decibel)
        return verdict, why, measured

    def _was_off(self, effect: str, plan: EffectPlan, before: EffectPlan) -> bool:
        return self.was_left_out(plan, before if effect == "plan" else restricted_to(before, effect))

    def measure(self, asked_of: Sequence[tuple[str, EffectPlan]]) -> list[Measured]:
        """What each plan loses against everything on; each is given with the effect that it leaves out."""
        if not asked_of:
            return []
        plans = [plan for _, plan in asked_of]
        asked: dict[tuple[int, str], Float[Tensor, "surfels views 3"]] = {}
        for place, plan in enumerate(plans):
            if plan.sh_degree < HIGHEST_DEGREE:
                asked[place, "own"] = self.radiance.own(plan.sh_degree)
            if replace(plan, sh_degree=HIGHEST_DEGREE).off:
                asked[place, "shaded"] = self.radiance.shaded(plan).detach()
            if "sharp" in self.full and "specular" in plan.off:
                asked[place, "sharp"] = self.radiance.shaded(plan, sharp=True).detach()
        images = self.pixels.take(rendered_views(self.radiance.projections, asked.values()))
        errors = {
            (place, kind): tile_errors(
                image, self.full[kind], self.pixels, light_factor_is_free(asked_of[place][0], self.scene)
            )
            for (place, kind), image in zip(asked, images, strict=True)
        }
        bounds = self._bounds(errors)
        return [
            self._measured(
                plan,
                {kind: errors[where, kind] for where, kind in errors if where == place},
                {kind: bounds[where, kind] for where, kind in bounds if where == place},
            )
            for place, plan in enumerate(plans)
        ]

    def _bounds(self, errors: Mapping[tuple[int, str], TileErrors]) -> dict[tuple[int, str], "_Bounds"]:
        """Bounds on the larger of mean difference and mean rise; sharp images have no target, and so no rise."""
        stacked = torch.cat([torch.stack([each.weighted_difference, each.weighted_rise]) for each in errors.values()])
        below, above = self.bootstrap.bounds(stacked)
        mean = stacked.double().mean(1).cpu()
        found = {}
        for place, key in enumerate(errors):
            rows = slice(2 * place, 2 * place + (1 if key[1] == "sharp" else 2))
            found[key] = _Bounds(
                float(mean[rows].max()), float(below[rows].max()), float(above[rows].max()), float(above[2 * place])
            )
        return found

    def _measured(
        self,
        plan: EffectPlan,
        errors: Mapping[str, TileErrors],
        bounds: Mapping[str, "_Bounds"],
    ) -> Measured:
        tolerance = self.tolerance
        worst_tile = max(float(each.difference.max()) for each in errors.values())
        tail = worst_tile / tolerance.local_error if tolerance.local_error > 0 else float(worst_tile > 0)
        tiles = len(next(iter(errors.values())).difference)
        saved = self.step.work(EffectPlan())["rays"] - self.step.work(plan)["rays"]
        seconds = 1e-6 * (cost(self.step.work(EffectPlan())) - cost(self.step.work(plan)))
        return Measured(
            contribution=max(tolerance.loss(each.mean) for each in bounds.values()),
            lowest=max(tolerance.loss(each.below) for each in bounds.values()),
            bound=max(tolerance.loss(each.above) for each in bounds.values()),
            worst=max(tolerance.worst_case(each.difference) for each in bounds.values()),
            tail=tail,
            unseen=zero_events_upper(tiles, self.level) if tail < 1 else 1.0,
            gradient=0.0,
            share=self.step.saving(plan, EffectPlan()),
            rays=round(saved),
            seconds=seconds,
        )


@dataclass(frozen=True)
class _Bounds:
    """Estimate of an error, its lower and upper bounds, and the upper bound of the difference alone."""

    mean: float
    below: float
    above: float
    difference: float


def image_gradient(radiance: PlanRadiance) -> Float[Tensor, "surfels views 3"]:
    """Gradient of the images' squared error with respect to the radiance that each surfel sends to each view.

    Zero for views without a target.
    """
    sent = radiance.shaded(EffectPlan()).detach().requires_grad_()
    total = sent.new_zeros(())
    for place, (view, projection) in enumerate(zip(radiance.scene.views, radiance.projections, strict=True)):
        if view.target is not None:
            raster = blend(projection, sent[:, place], 1.0)
            image = displayed(raster.features, raster.alpha, radiance.scene.straight)
            total = total + (image - view.target).square().mean()
    return torch.autograd.grad(total, sent)[0] if total.requires_grad else torch.zeros_like(sent)


class Gradients:
    """Gradients of albedo, roughness and light that the error of the full images causes, and how plans change them."""

    def __init__(self, radiance: PlanRadiance) -> None:
        self.radiance = radiance

    @cached_property
    def upstream(self) -> Float[Tensor, "surfels views 3"]:
        """Upstream gradient, the same for every plan."""
        return image_gradient(self.radiance)

    @cached_property
    def full(self) -> dict[str, Tensor]:
        """With everything on."""
        return self.of(EffectPlan())

    def of(self, plan: EffectPlan) -> dict[str, Tensor]:
        """Gradients under a plan, by name of the leaf."""
        leaves = self.radiance.leaves
        found = torch.autograd.grad(
            self.radiance.shaded(plan), list(leaves.values()), self.upstream, retain_graph=True, allow_unused=True
        )
        return {
            name: torch.zeros_like(leaf) if value is None else value
            for (name, leaf), value in zip(leaves.items(), found, strict=True)
        }

    def change(self, plan: EffectPlan) -> float:
        """Largest |g_plan - g_full| / |g_full| over the leaves; infinite where a gradient appears out of none.

        Roughness counts only where the plan has specular lobes everywhere: elsewhere it is left unlearnt on purpose,
        and what it could still do to the images is measured by ``ProbeScene.sharpest``.
        """
        shiny = plan.specular and plan.specular_at is None
        return max(
            _relative(value - self.full[name], self.full[name])
            for name, value in self.of(plan).items()
            if shiny or name != "roughness"
        )


def _relative(change: Tensor, whole: Tensor) -> float:
    moved, length = float(change.norm()), float(whole.norm())
    if length > 0:
        return moved / length
    return 0.0 if moved == 0 else float("inf")
