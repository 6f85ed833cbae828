"""The initial viewpoint of an interactive viewer, and the centre and arc of a turntable."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.camera import Camera
from radiogs_core.scene.scene import Scene

UPRIGHT = 0.7
"""Cosine between Z and the cameras' mean upward direction above which Z is up in scenes with a light for each view."""

NEARLY = math.cos(math.radians(10))
"""Cosine between Z and a capture's estimated upward direction above which Z is up."""

VAGUE = 0.5
"""Length of the cameras' mean upward direction below which it is too vague to tell what is up."""

WIDE = math.radians(60)
"""Smallest angle between neighbouring cameras, in radians, that counts as a side from which nothing was seen."""


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
    """The viewpoint at the centre of the camera ``eye``, with the scene's ``upwards``."""
    cameras = [view.camera for view in (*scene.train, *scene.test)]
    position, up = eye.centre.float().cpu(), upwards(scene)
    if not scene.surrounded:
        return InitialViewpoint(position, up)
    middle = scene.centre.float()
    positions = torch.stack([each.centre.float().cpu() for each in cameras])
    return InitialViewpoint(position, up, middle, _arc(positions, position, up, middle))


def _arc(
    positions: Float[Tensor, "cameras 3"], eye: Float[Tensor, "3"], up: Float[Tensor, "3"], middle: Float[Tensor, "3"]
) -> Float[Tensor, "2"] | None:
    """The smallest arc about ``up`` that holds all positions, relative to the eye; None if all gaps are below WIDE."""
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


def upwards(scene: Scene) -> Float[Tensor, "3"]:
    """The unit upward direction of a scene's world.

    It is Z if the scene has lights of its own, which are stored Z up. Else it is estimated from the cameras: Z within
    UPRIGHT of their mean upward direction where each view has a light in its camera's axes, and within NEARLY of it in
    captures, whose worlds have any orientation. People hold cameras level, so up is the direction at right angles to
    all images' rows; if rows are too alike for that, it is the mean.
    """
    z = torch.tensor([0.0, 0.0, 1.0])
    if (scene.lights or scene.training_light is not None) and not scene.relight:
        return z
    axes = torch.stack([view.camera.axes.double().cpu() for view in (*scene.train, *scene.test)])
    mean = -axes[..., 1].mean(0)
    if scene.relight:
        mean = (mean / mean.norm().clamp(min=1e-6)).float()
        return z if mean[2] > UPRIGHT else mean
    up = _across_rows(axes[..., 0], mean)
    if up is None:
        up = _sideways(axes) if float(mean.norm()) < VAGUE else mean / mean.norm()
    return z if up is None or up[2] > NEARLY else up.float()


def _across_rows(rows: Float[Tensor, "cameras 3"], mean: Float[Tensor, "3"]) -> Float[Tensor, "3"] | None:
    """The direction perpendicular to the rows of all images, on the side of ``mean``; None if rows are too alike."""
    spread, directions = torch.linalg.eigh(rows.T @ rows / len(rows))
    along = float(directions[:, 0] @ mean)
    told = float(spread[1]) > 0.01 and float(spread[0]) < 0.2 * float(spread[1]) and abs(along) > 0.1
    return directions[:, 0] * (1.0 if along > 0 else -1.0) if told else None


def _sideways(axes: Float[Tensor, "cameras 3 3"]) -> Float[Tensor, "3"] | None:
    """Upward direction of portrait photos that are stored lying; they look down on average. None if rows differ."""
    rows = axes[..., 0].mean(0)
    if float(rows.norm()) < 0.5:
        return None
    up = rows / rows.norm()
    return up if float(axes[..., 2].mean(0) @ up) <= 0 else -up
