"""The training views a stage learns from, and the order in which it sees them."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from ..errors import DataError
from ..scene.camera import Camera
from ..scene.scene import Scene, View


@dataclass(frozen=True)
class TrainingView:
    """One training view on the device: camera, straight display-sRGB image and coverage."""

    camera: Camera
    image: Float[Tensor, "height width 3"]
    mask: Float[Tensor, "height width"]

    def over(self, background: float) -> Float[Tensor, "height width 3"]:
        """The image composited on a grey background, in display sRGB (as every splatting code does)."""
        mask = self.mask[..., None]
        return self.image * mask + background * (1 - mask)


def chosen_views(scene: Scene, share: float, seed: int) -> tuple[View, ...]:
    """A seeded random subset of the training views: ceil(share * count) of them, at least one."""
    if not scene.train:
        raise DataError(f"scene '{scene.name}' has no training views", "Nothing can be learnt from it.")
    count = max(1, -int(-len(scene.train) * share // 1))
    order = torch.randperm(len(scene.train), generator=torch.Generator().manual_seed(seed))
    return tuple(scene.train[int(place)] for place in order[:count].sort().values)


def load(views: tuple[View, ...], device: torch.device) -> tuple[TrainingView, ...]:
    """Read the views onto the device. A view without alpha is covered everywhere."""

    def one(view: View) -> TrainingView:
        image = view.read("image")
        mask = view.read("alpha")[..., 0] if view.has("alpha") else torch.ones(image.shape[:2])
        return TrainingView(view.camera.to(device, torch.float32), image.to(device), mask.to(device))

    return tuple(one(view) for view in views)


def view_at(views: tuple[TrainingView, ...], iteration: int, seed: int) -> TrainingView:
    """The view of an iteration: each epoch is a fresh permutation, a function of seed and epoch alone."""
    epoch, place = divmod(iteration, len(views))
    generator = torch.Generator().manual_seed(seed * 1_000_003 + epoch)
    return views[int(torch.randperm(len(views), generator=generator)[place])]


def mean_distance(views: tuple[TrainingView, ...], centre: Float[Tensor, "3"]) -> float:
    """Mean distance of the cameras from the scene's centre, world units."""
    return float(torch.stack([(view.camera.centre.cpu().double() - centre).norm() for view in views]).mean())
