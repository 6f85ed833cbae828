"""Rays through random pixels of the training views."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import normalize

from radiogs_core.learning.views import TrainingView, view_at
from radiogs_core.scene.camera import Camera

from .box import Box
from .marching import Rays
from .settings import Budget


@dataclass(frozen=True)
class Drawn:
    """Rays, what their pixels show on a background, and that background; both display sRGB."""

    rays: Rays
    target: Float[Tensor, "rays 3"]
    background: Float[Tensor, "rays 1"]


def camera_rays(camera: Camera, box: Box) -> Rays:
    """Rays through the centres of all pixels, row by row."""
    direction = normalize(camera.ray_directions().flatten(0, 1), dim=-1)
    return Rays(box.local(camera.centre).expand_as(direction), direction)


def drawn_rays(
    views: Sequence[TrainingView], box: Box, budget: Budget, order: tuple[int, int], generator: torch.Generator,
    random_background: bool,
) -> Drawn:  # fmt: skip
    """``budget.rays`` rays, shared out evenly among ``budget.views`` views; every epoch sees each view once.

    ``order``: iteration and seed, which decide the views. Backgrounds are grey: one value a ray, or white.
    """
    iteration, seed = order
    count = min(budget.views, len(views))
    each = max(1, budget.rays // count)
    origins, directions, straight, masks = [], [], [], []
    for place in range(count):
        view = view_at(tuple(views), iteration * count + place, seed)
        rays, image = camera_rays(view.camera, box), view.image.flatten(0, 1)
        pixel = torch.randint(len(image), (each,), generator=generator, device=image.device)
        origins.append(rays.origin[pixel])
        directions.append(rays.direction[pixel])
        straight.append(image[pixel])
        masks.append(view.mask.flatten()[pixel, None])
    mask = torch.cat(masks)
    background = torch.ones_like(mask)
    if random_background:
        background = torch.rand(mask.shape, generator=generator, device=mask.device)
    target = torch.cat(straight) * mask + background * (1 - mask)
    return Drawn(Rays(torch.cat(origins), torch.cat(directions)), target, background)
