"""Batches of rays through random pixels of the training views."""

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
class RayBatch:
    """Rays with the colours of their pixels."""

    rays: Rays
    """The rays, in the box's local coordinates."""
    target: Float[Tensor, "rays 3"]
    """Colour of each ray's pixel, composited on ``background``, display sRGB."""
    background: Float[Tensor, "rays 1"]
    """Grey level behind each ray, display sRGB."""


def camera_rays(camera: Camera, box: Box) -> Rays:
    """Rays through the centres of all pixels, row by row, in the box's local coordinates."""
    direction = normalize(camera.ray_directions().flatten(0, 1), dim=-1)
    return Rays(box.local(camera.centre).expand_as(direction), direction)


def ray_batch(
    views: Sequence[TrainingView], box: Box, budget: Budget, order: tuple[int, int], generator: torch.Generator,
    random_background: bool,
) -> RayBatch:  # fmt: skip
    """Draw ``budget.rays`` rays, divided evenly among ``budget.views`` views; every epoch contains each view once.

    Rays have the local coordinates of ``box``. ``order``: iteration and seed, which select the views; ``generator``
    draws pixels and, if ``random_background``, a grey background of each ray, which is white otherwise.
    """
    iteration, seed = order
    count = min(budget.views, len(views))
    each = max(1, budget.rays // count)
    origins, directions, straight, masks = [], [], [], []
    for index in range(count):
        view = view_at(tuple(views), iteration * count + index, seed)
        rays, image = camera_rays(view.camera, box), view.image.flatten(0, 1)
        usable = view.counting(torch.arange(len(image), device=image.device))
        pixel = usable[torch.randint(len(usable), (each,), generator=generator, device=image.device)]
        origins.append(rays.origin[pixel])
        directions.append(rays.direction[pixel])
        straight.append(image[pixel])
        masks.append(view.mask.flatten()[pixel, None])
    mask = torch.cat(masks)
    background = torch.ones_like(mask)
    if random_background:
        background = torch.rand(mask.shape, generator=generator, device=mask.device)
    target = torch.cat(straight) * mask + background * (1 - mask)
    return RayBatch(Rays(torch.cat(origins), torch.cat(directions)), target, background)
