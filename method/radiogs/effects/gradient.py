"""How leaving an effect out changes the gradients: an effect that hardly changes images may carry the only gradient."""

from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.kernels.image.display import displayed
from radiogs_core.kernels.rasterize.rasterize import blend
from radiogs_core.transport.plan import EffectPlan, everything

from .plan_radiance import PlanRadiance


def image_gradient(radiance: PlanRadiance) -> Float[Tensor, "surfels views 3"]:
    """Gradient of the images' squared error with respect to the radiance that each surfel sends to each view.

    Zero for views without a target.
    """
    sent = radiance.shaded(everything()).detach().requires_grad_()
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
        return self.of(everything())

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
