"""From where a scene is looked at first, and around what a turntable turns."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from .camera import Camera
from .scene import Scene

UPRIGHT = 0.7
"""Cosine between Z and the mean upward direction of cameras from which on Z is up; captures have axes of their own."""

WIDE = math.radians(60)
"""A gap between neighbouring cameras that is at least so wide is a side from which the scene was not seen."""


@dataclass(frozen=True)
class Standpoint:
    """World units. eye: a camera's centre. up: unit. middle: what is looked at; None: the middle of the model itself.

    A scene without masks has a model of a whole room, in whose middle there is nothing to be seen. arc: how far its
    cameras go round the middle, from the eye to either side, radians about ``up``; None: all round.
    """

    eye: Float[Tensor, "3"]
    up: Float[Tensor, "3"]
    middle: Float[Tensor, "3"] | None = None
    arc: Float[Tensor, "2"] | None = None

    def plain(self) -> dict[str, list[float]]:
        """As plain values."""
        named = {"eye": self.eye, "up": self.up, "middle": self.middle, "arc": self.arc}
        return {name: value.tolist() for name, value in named.items() if value is not None}


def standpoint(scene: Scene, eye: Camera) -> Standpoint:
    """Where ``eye`` stands in a scene; Z is up where the cameras stand upright."""
    cameras = [view.camera for view in (*scene.train, *scene.test)]
    place, up = eye.centre.float().cpu(), upwards(cameras)
    if not scene.surrounded:
        return Standpoint(place, up)
    middle = scene.centre.float()
    return Standpoint(
        place, up, middle, _arc(torch.stack([each.centre.float().cpu() for each in cameras]), place, up, middle)
    )


def _arc(
    places: Float[Tensor, "cameras 3"], eye: Float[Tensor, "3"], up: Float[Tensor, "3"], middle: Float[Tensor, "3"]
) -> Float[Tensor, "2"] | None:
    """The arc about ``up`` that all places are within, as seen from the eye's; None where no gap of it is WIDE."""
    forth = eye - middle
    side = torch.linalg.cross(up, forth)
    level = (places - middle) - ((places - middle) @ up)[:, None] * up
    angles = torch.atan2(level @ side, level @ forth).sort().values
    gaps = torch.cat([angles[1:], angles[:1] + 2 * torch.pi]) - angles
    widest = int(gaps.argmax())
    if gaps[widest] < WIDE:
        return None
    end = angles[widest]
    begin = angles[(widest + 1) % len(angles)]
    return torch.stack([begin - 2 * torch.pi if begin > 0 else begin, end if end >= 0 else end + 2 * torch.pi])


def upwards(cameras: Sequence[Camera]) -> Float[Tensor, "3"]:
    """The mean upward direction of cameras, or Z where that is near."""
    mean = -torch.stack([camera.axes[:, 1].float().cpu() for camera in cameras]).mean(0)
    mean = mean / mean.norm().clamp(min=1e-6)
    return torch.tensor([0.0, 0.0, 1.0]) if mean[2] > UPRIGHT else mean
