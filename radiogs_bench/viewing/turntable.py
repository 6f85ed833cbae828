"""A turntable: the surfels of a model as cameras around it see them, blended in linear light on white."""

import math
from collections.abc import Iterator, Sequence
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.order_statistics import quantile
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.colour import srgb_decode, srgb_encode
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.splatting import own_radiance, splat

Colour = Literal["radiance", "albedo", "normal", "roughness"]

ELEVATION = 25.0
"""Of the cameras, degrees above the horizon."""

FIELD = 40.0
"""Field of view, degrees."""

WITHIN = 0.98
"""Share of the surfels that fits into the picture: single ones may be far away."""


def cameras_around(surfels: Surfels, frames: int, size: int) -> list[Camera]:
    """Cameras of ``size`` x ``size`` pixels on a circle around the surfels; Z is up, and the first is towards +X."""
    middle = surfels.centre.median(0).values
    distances = (surfels.centre - middle).norm(dim=-1)
    radius = quantile(lambda: [distances], WITHIN)
    away = max(radius or 0.0, 1e-6) / math.sin(math.radians(FIELD / 2))
    tilt = math.radians(ELEVATION)
    cameras = []
    for frame in range(frames):
        turn = 2 * math.pi * frame / frames
        back = (math.cos(turn) * math.cos(tilt), math.sin(turn) * math.cos(tilt), math.sin(tilt))
        cameras.append(_looking_back(middle, torch.tensor(back), away, size))
    return cameras


def _looking_back(target: Tensor, back: Tensor, away: float, size: int) -> Camera:
    right = torch.nn.functional.normalize(torch.linalg.cross(torch.tensor([0.0, 0.0, 1.0]), back), dim=0)
    pose = torch.eye(4)
    pose[:3, :3] = torch.stack([right, torch.linalg.cross(right, back), -back], -1)
    pose[:3, 3] = target + away * back
    focal = size / 2 / math.tan(math.radians(FIELD / 2))
    return Camera(pose, focal, focal, size / 2, size / 2, size, size)


def pictures(surfels: Surfels, cameras: Sequence[Camera], colour: Colour) -> Iterator[Float[Tensor, "height width 3"]]:
    """What each camera sees, display sRGB on white."""
    for camera in cameras:
        with torch.no_grad():
            seen = splat(camera, surfels, {"colour": _linear(surfels, camera, colour)}, depth_unit=1.0)
            yield srgb_encode(seen.images["colour"] + 1 - seen.alpha[..., None]).clamp(0, 1)


def _linear(surfels: Surfels, camera: Camera, colour: Colour) -> Float[Tensor, "surfels 3"]:
    """What is shown of each surfel as linear colour: radiance is that towards the camera."""
    if colour == "radiance":
        return own_radiance(camera, surfels)
    if colour == "albedo":
        return surfels.albedo
    shown = surfels.frame[..., 2] * 0.5 + 0.5 if colour == "normal" else surfels.roughness[:, None].expand(-1, 3)
    return srgb_decode(shown)
