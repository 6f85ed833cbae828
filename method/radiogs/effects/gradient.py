"""What leaving something out changes in the gradients: an image may hardly change and carry the only gradient."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from ..colour import srgb_encode
from ..rendering import splat
from .candidates import Candidates
from .plan import EffectPlan, everything


def pull_of_images(candidates: Candidates) -> Float[Tensor, "surfels views 3"]:
    """Gradient of the images' squared error to the radiance that each surfel sends to each sight.

    Zero where there is no target.
    """
    sights, surfels = candidates.subject.sights, candidates.subject.surfels
    radiance = candidates.radiance(everything()).detach().requires_grad_()
    total = radiance.new_zeros(())
    for place, sight in enumerate(sights):
        if sight.target is not None:
            image = splat(sight.camera, surfels, {"shaded": radiance[:, place]}, 1.0).images["shaded"]
            total = total + (srgb_encode(image) - sight.target).square().mean()
    return torch.autograd.grad(total, radiance)[0] if total.requires_grad else torch.zeros_like(radiance)


def gradient_changes(
    candidates: Candidates, plans: Sequence[EffectPlan], pull: Float[Tensor, "surfels views 3"]
) -> list[dict[str, float]]:
    """|g_plan - g_full| / |g_full| of each plan by leaf, under the same ``pull`` on the surfels' radiance.

    Roughness counts only where the plan has a specular part everywhere: elsewhere it is not learnt on purpose, and what
    it could still do to the images is judged there. Infinite where a gradient appears out of none.
    """
    leaves = candidates.leaves

    def gradients(plan: EffectPlan) -> dict[str, Tensor]:
        found = torch.autograd.grad(
            candidates.radiance(plan), list(leaves.values()), pull, retain_graph=True, allow_unused=True
        )
        return {
            name: torch.zeros_like(leaf) if value is None else value
            for (name, leaf), value in zip(leaves.items(), found, strict=True)
        }

    full = gradients(everything())
    return [
        {
            name: _relative(value - full[name], full[name])
            for name, value in gradients(plan).items()
            if name != "roughness" or (plan.specular and plan.specular_at is None)
        }
        for plan in plans
    ]


def _relative(change: Tensor, whole: Tensor) -> float:
    moved, length = float(change.norm()), float(whole.norm())
    if length > 0:
        return moved / length
    return 0.0 if moved == 0 else float("inf")
