"""From where a scene is looked at first, and around what a turntable turns."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from .camera import Camera
from .scene import Scene

UPRIGHT = 0.7
"""Cosine between Z and the mean upward direction of cameras from which on Z is up; captures have axes of their own."""


@dataclass(frozen=True)
class Standpoint:
    """World units. eye: a camera's centre. up: unit. middle: what is looked at; None: the middle of the model itself.

    A scene without masks has a model of a whole room, in whose middle there is nothing to be seen.
    """

    eye: Float[Tensor, "3"]
    up: Float[Tensor, "3"]
    middle: Float[Tensor, "3"] | None = None

    def plain(self) -> dict[str, list[float]]:
        """As plain values."""
        named = {"eye": self.eye, "up": self.up, "middle": self.middle}
        return {name: value.tolist() for name, value in named.items() if value is not None}


def standpoint(scene: Scene, eye: Camera) -> Standpoint:
    """Where ``eye`` stands in a scene; Z is up where the cameras stand upright."""
    middle = scene.centre.float() if scene.surrounded else None
    return Standpoint(eye.centre.float().cpu(), upwards([view.camera for view in (*scene.train, *scene.test)]), middle)


def upwards(cameras: Sequence[Camera]) -> Float[Tensor, "3"]:
    """The mean upward direction of cameras, or Z where that is near."""
    mean = -torch.stack([camera.axes[:, 1].float().cpu() for camera in cameras]).mean(0)
    mean = mean / mean.norm().clamp(min=1e-6)
    return torch.tensor([0.0, 0.0, 1.0]) if mean[2] > UPRIGHT else mean
