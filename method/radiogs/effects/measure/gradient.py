"""What leaving something out changes in the gradients: an image may hardly change and carry the only gradient."""

from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.kernels.rasterize.rasterize import blend
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.transport.plan import EffectPlan, everything

from .plan_radiance import PlanRadiance


def image_gradient(candidates: PlanRadiance) -> Float[Tensor, "surfels views 3"]:
    """Gradient of the images' squared error to the radiance that each surfel sends to each sight.

    Zero where there is no target.
    """
    radiance = candidates.radiance(everything()).detach().requires_grad_()
    total = radiance.new_zeros(())
    for place, (sight, view) in enumerate(zip(candidates.subject.sights, candidates.projections, strict=True)):
        if sight.target is not None:
            image = blend(view, radiance[:, place], 1.0).features
            total = total + (srgb_encode(image) - sight.target).square().mean()
    return torch.autograd.grad(total, radiance)[0] if total.requires_grad else torch.zeros_like(radiance)


class Gradients:
    """Gradients of albedo, roughness and light under the pull of the full images, and how plans change them."""

    def __init__(self, candidates: PlanRadiance) -> None:
        self.candidates = candidates

    @cached_property
    def pull(self) -> Float[Tensor, "surfels views 3"]:
        """The same for all plans: what differs is what a plan hands on of it."""
        return image_gradient(self.candidates)

    @cached_property
    def full(self) -> dict[str, Tensor]:
        """With everything on."""
        return self.of(everything())

    def of(self, plan: EffectPlan) -> dict[str, Tensor]:
        """By leaf, under a plan."""
        leaves = self.candidates.leaves
        found = torch.autograd.grad(
            self.candidates.radiance(plan), list(leaves.values()), self.pull, retain_graph=True, allow_unused=True
        )
        return {
            name: torch.zeros_like(leaf) if value is None else value
            for (name, leaf), value in zip(leaves.items(), found, strict=True)
        }

    def change(self, plan: EffectPlan) -> float:
        """Largest |g_plan - g_full| / |g_full| over the leaves; infinite where a gradient appears out of none.

        Roughness counts only where the plan has a specular part everywhere: elsewhere it is not learnt on purpose, and
        what it could still do to the images is judged there.
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
