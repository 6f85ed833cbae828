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
from .budget import Budget
from .marching import Rays


@dataclass(frozen=True)
class Drawn:
    """Rays, and what their pixels show on white, display sRGB."""

    rays: Rays
    target: Float[Tensor, "rays 3"]


def camera_rays(camera: Camera, box: Box) -> Rays:
    """Rays through the centres of all pixels, row by row."""
    direction = normalize(camera.ray_directions().flatten(0, 1), dim=-1)
    return Rays(box.local(camera.centre).expand_as(direction), direction)


def drawn_rays(
    views: Sequence[TrainingView], box: Box, budget: Budget, iteration: int, seed: int, generator: torch.Generator
) -> Drawn:
    """``budget.rays`` rays, shared out evenly among ``budget.views`` views; every epoch sees each view once."""
    count = min(budget.views, len(views))
    each = max(1, budget.rays // count)
    origins, directions, targets = [], [], []
    for place in range(count):
        view = view_at(tuple(views), iteration * count + place, seed)
        rays, image = camera_rays(view.camera, box), view.over(1.0).flatten(0, 1)
        pixel = torch.randint(len(image), (each,), generator=generator, device=image.device)
        origins.append(rays.origin[pixel])
        directions.append(rays.direction[pixel])
        targets.append(image[pixel])
    return Drawn(Rays(torch.cat(origins), torch.cat(directions)), torch.cat(targets))
