"""The initial viewpoint of an interactive viewer, and the centre and arc of a turntable."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from .camera import Camera
from .scene import Scene

UPRIGHT = 0.7
"""Cosine between Z and the cameras' mean upward direction above which Z is up; captures may have other axes."""

WIDE = math.radians(60)
"""Least angle between neighbouring cameras, in radians, for the side between them to count as not seen."""


@dataclass(frozen=True)
class InitialViewpoint:
    """Where a viewer starts and which way is up, in the world."""

    eye: Float[Tensor, "3"]
    """Position of the viewer, world units: the centre of a camera."""
    up: Float[Tensor, "3"]
    """Upward direction, unit."""
    middle: Float[Tensor, "3"] | None = None
    """Point that the viewer looks at, world units; None for the centre of the model. The model of a scene without masks
    is a whole room, whose centre may be empty."""
    arc: Float[Tensor, "2"] | None = None
    """First and last angle, in radians about ``up`` from the eye, of the arc around ``middle`` from which cameras saw
    the scene; None for a full circle."""

    def plain(self) -> dict[str, list[float]]:
        """The fields that are not None, as plain values by name."""
        named = {"eye": self.eye, "up": self.up, "middle": self.middle, "arc": self.arc}
        return {name: value.tolist() for name, value in named.items() if value is not None}


def initial_viewpoint(scene: Scene, eye: Camera) -> InitialViewpoint:
    """The viewpoint at the centre of the camera ``eye``; Z is up where the cameras of the scene are upright."""
    cameras = [view.camera for view in (*scene.train, *scene.test)]
    position, up = eye.centre.float().cpu(), upwards(cameras)
    if not scene.surrounded:
        return InitialViewpoint(position, up)
    middle = scene.centre.float()
    positions = torch.stack([each.centre.float().cpu() for each in cameras])
    return InitialViewpoint(position, up, middle, _arc(positions, position, up, middle))


def _arc(
    positions: Float[Tensor, "cameras 3"], eye: Float[Tensor, "3"], up: Float[Tensor, "3"], middle: Float[Tensor, "3"]
) -> Float[Tensor, "2"] | None:
    """The smallest arc about ``up`` that holds all positions, relative to the eye; None where no gap is WIDE."""
    forth = eye - middle
    side = torch.linalg.cross(up, forth)
    level = (positions - middle) - ((positions - middle) @ up)[:, None] * up
    angles = torch.atan2(level @ side, level @ forth).sort().values
    gaps = torch.cat([angles[1:], angles[:1] + 2 * torch.pi]) - angles
    widest = int(gaps.argmax())
    if gaps[widest] < WIDE:
        return None
    end = angles[widest]
    begin = angles[(widest + 1) % len(angles)]
    return torch.stack([begin - 2 * torch.pi if begin > 0 else begin, end if end >= 0 else end + 2 * torch.pi])


def upwards(cameras: Sequence[Camera]) -> Float[Tensor, "3"]:
    """The unit mean upward direction of cameras, or Z if that is within UPRIGHT of it."""
    mean = -torch.stack([camera.axes[:, 1].float().cpu() for camera in cameras]).mean(0)
    mean = mean / mean.norm().clamp(min=1e-6)
    return torch.tensor([0.0, 0.0, 1.0]) if mean[2] > UPRIGHT else mean
