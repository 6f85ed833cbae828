"""Measures how plans change the full images of a scene, and decides by these measurements.

``Gradients`` measures how a plan changes gradients: an effect that hardly changes images may carry the only gradient.
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

from .bounds import bootstrap_t, zero_events_upper
from .covered_pixels import CoveredPixels, rendered_views
from .decision import decide
from .evidence import Measured, Verdict
from .plan_radiance import PlanRadiance
from .probe_scene import ProbeScene
from .step_cost import Step
from .substitutes import restricted_to
from .tile_errors import ReferenceImage, TileErrors, mean_error, tile_errors
from .tolerance import Tolerance

NOT_ABSORBED = ("view-dependence", "samples")
"""Effects whose absence cannot be compensated by a factor on the light."""


def light_factor_is_free(effect: str, scene: ProbeScene) -> bool:
    """Whether a factor on the light may compensate a change of all pixels that the missing effect causes."""
    return effect not in NOT_ABSORBED and not scene.given_light


class Assessment:
    """Measures plans by comparison with the images of a scene with all effects on.

    ``level``: error probability of each bound. ``decibel``: tolerated loss, dB of PSNR, relative to ``mse``. ``mse``:
    the method's own mean squared error, display sRGB; None: the smaller of the errors of the shaded images and of the
    surfels' own radiance, against the views' targets.
    """

    def __init__(
        self, scene: ProbeScene, step: Step, seed: int, level: float, decibel: float, mse: float | None
    ) -> None:
        self.scene, self.step, self.seed, self.level, self.mse = scene, step, seed, level, mse
        self.generator = torch.Generator().manual_seed(seed)
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
        images = zip(full, self.pixels.take(rendered), strict=True)
        self.full = {name: ReferenceImage.of(image, self.pixels) for name, image in images}
        if mse is None:
            mse = min(mean_error(self.full[name], self.pixels) for name in ("shaded", "own"))
        self.tolerance = Tolerance(mse, decibel)

    def of(self, scene: ProbeScene, level: float) -> "Assessment":
        """An assessment with these settings of another scene, and with another ``level``."""
        return Assessment(scene, self.step, self.seed, level, self.tolerance.decibel, self.mse)

    def was_left_out(self, plan: EffectPlan, before: EffectPlan) -> bool:
        """Whether ``plan`` saves no more work than ``before`` did; a plan that saves more passes a stricter rule."""
        return bool(before.off) and self.step.saving(plan, EffectPlan()) <= self.step.saving(before, EffectPlan())

    def by_images(self, effect: str, plan: EffectPlan, measured: Measured, before: EffectPlan) -> tuple[Verdict, str]:
        """Verdict and reason by images alone, without gradients; ``before`` is the plan until now, for hysteresis."""
        return decide(measured, self._was_off(effect, plan, before), self.tolerance.decibel)

    def decided(
        self, effect: str, plan: EffectPlan, measured: Measured, before: EffectPlan
    ) -> tuple[Verdict, str, Measured]:
        """Verdict, reason and measurements, by images and gradients.

        Gradients cost most and come last: a plan that the images refuse needs none.
        """
        verdict, why = self.by_images(effect, plan, measured, before)
        if verdict == "off" and replace(plan, sh_degree=HIGHEST_DEGREE).off:
            measured = replace(measured, gradient=self.gradients.change(plan))
            verdict, why = decide(measured, self._was_off(effect, plan, before), self.tolerance.decibel)
        return verdict, why, measured

    def _was_off(self, effect: str, plan: EffectPlan, before: EffectPlan) -> bool:
        return self.was_left_out(plan, before if effect == "plan" else restricted_to(before, effect))

    def measure(self, reductions: Sequence[tuple[str, EffectPlan]]) -> list[Measured]:
        """Loss of each plan, compared with all effects on; ``reductions``: pairs of the missing effect and the plan."""
        if not reductions:
            return []
        plans = [plan for _, plan in reductions]
        radiance: dict[tuple[int, str], Float[Tensor, "surfels views 3"]] = {}
        for index, plan in enumerate(plans):
            if plan.sh_degree < HIGHEST_DEGREE:
                radiance[index, "own"] = self.radiance.own(plan.sh_degree)
            if replace(plan, sh_degree=HIGHEST_DEGREE).off:
                radiance[index, "shaded"] = self.radiance.shaded(plan).detach()
            if "sharp" in self.full and "specular" in plan.off:
                radiance[index, "sharp"] = self.radiance.shaded(plan, sharp=True).detach()
        images = self.pixels.take(rendered_views(self.radiance.projections, radiance.values()))
        errors = {
            (index, kind): tile_errors(
                image, self.full[kind], self.pixels, light_factor_is_free(reductions[index][0], self.scene)
            )
            for (index, kind), image in zip(radiance, images, strict=True)
        }
        bounds = self._bounds(errors)
        return [
            self._measured(
                plan,
                {kind: errors[which, kind] for which, kind in errors if which == index},
                {kind: bounds[which, kind] for which, kind in bounds if which == index},
            )
            for index, plan in enumerate(plans)
        ]

    def _bounds(self, errors: Mapping[tuple[int, str], TileErrors]) -> dict[tuple[int, str], "_Bounds"]:
        """Bounds on the larger of mean difference and mean rise; sharp images have no target, hence no rise."""
        stacked = torch.cat([each.weighted for each in errors.values()])
        below, above = bootstrap_t(stacked, self.level, self.generator)
        mean = stacked.double().mean(1).cpu()
        bounds = {}
        for index, key in enumerate(errors):
            rows = slice(2 * index, 2 * index + (1 if key[1] == "sharp" else 2))
            largest = [float(values[rows].max()) for values in (mean, below, above)]
            bounds[key] = _Bounds(float(above[2 * index]), *largest)
        return bounds

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
        return Measured(
            contribution=max(tolerance.loss(each.mean) for each in bounds.values()),
            lowest=max(tolerance.loss(each.below) for each in bounds.values()),
            bound=max(tolerance.loss(each.above) for each in bounds.values()),
            worst=max(tolerance.worst_case(each.difference) for each in bounds.values()),
            tail=tail,
            unseen=zero_events_upper(tiles, self.level) if tail < 1 else 1.0,
            **self.step.saved(plan, EffectPlan()),
        )


@dataclass(frozen=True)
class _Bounds:
    """Estimate of a squared error, display sRGB, with its bounds."""

    difference: float
    """Upper bound of the mean squared difference between the two images, whatever the target."""
    mean: float
    """The estimate."""
    below: float
    """Lower bound."""
    above: float
    """Upper bound."""


def image_gradient(radiance: PlanRadiance) -> Float[Tensor, "surfels views 3"]:
    """Gradient of the images' squared error with respect to the radiance of each surfel towards each view.

    The error is the mean over pixels and channels, display sRGB. The gradient is zero for views without a target.
    """
    sent = radiance.shaded(EffectPlan()).detach().requires_grad_()
    total = sent.new_zeros(())
    for index, (view, projection) in enumerate(zip(radiance.scene.views, radiance.projections, strict=True)):
        if view.target is not None:
            raster = blend(projection, sent[:, index], 1.0)
            image = displayed(raster.features, raster.alpha, radiance.scene.straight)
            total = total + (image - view.target).square().mean()
    return torch.autograd.grad(total, sent)[0] if total.requires_grad else torch.zeros_like(sent)


class Gradients:
    """Gradients of the full images' error for albedo, roughness and light, and their change under plans."""

    def __init__(self, radiance: PlanRadiance) -> None:
        self.radiance = radiance

    @cached_property
    def upstream(self) -> Float[Tensor, "surfels views 3"]:
        """Gradient with respect to the surfels' radiance; the same for every plan."""
        return image_gradient(self.radiance)

    @cached_property
    def full(self) -> dict[str, Tensor]:
        """Gradients with all effects on, by name of the leaf."""
        return self.of(EffectPlan())

    def of(self, plan: EffectPlan) -> dict[str, Tensor]:
        """Gradients under a plan, by name of the leaf."""
        leaves = self.radiance.leaves
        gradients = torch.autograd.grad(
            self.radiance.shaded(plan), list(leaves.values()), self.upstream, retain_graph=True, allow_unused=True
        )
        return {
            name: torch.zeros_like(leaf) if value is None else value
            for (name, leaf), value in zip(leaves.items(), gradients, strict=True)
        }

    def change(self, plan: EffectPlan) -> float:
        """Largest |g_plan - g_full| / |g_full| over the leaves; infinite where only g_full is zero.

        Roughness counts only if the plan has specular lobes on all surfels: without a lobe it is not learnt on purpose,
        and ``ProbeScene.sharpest`` measures how much another roughness could change the images.
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
