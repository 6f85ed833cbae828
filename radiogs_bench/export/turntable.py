"""A turntable: the surfels of a model as cameras around it see them, blended in linear light on white."""

import math
from collections.abc import Iterator, Sequence
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import normalize

from radiogs_core.order_statistics import quantile
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.colour import srgb_decode, srgb_encode
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.splatting import own_radiance, splat

from ..initial_viewpoint import InitialViewpoint

Colour = Literal["radiance", "albedo", "normal", "roughness"]

ELEVATION = 25.0
"""Elevation of the cameras, degrees above the horizon."""

FIELD = 40.0
"""Field of view, degrees."""

WITHIN = 0.98
"""Share of the surfels that the picture holds; the rest may be outliers far away."""

X, Z = torch.tensor([1.0, 0.0, 0.0]), torch.tensor([0.0, 0.0, 1.0])


def from_outside(surfels: Surfels) -> InitialViewpoint:
    """The viewpoint for a model whose cameras are unknown: from +X, with Z up."""
    return InitialViewpoint(surfels.centre.median(0).values + X, Z)


def cameras_around(surfels: Surfels, frames: int, size: int, seen_from: InitialViewpoint) -> list[Camera]:
    """Cameras of ``size`` x ``size`` pixels on a circle, the first on the side of the viewpoint's eye.

    They turn around the surfels, from above and so far away that all are seen; where the viewpoint has a middle,
    around that one, as high and as far away as its eye, and no further than its arc.
    """
    up, middle = seen_from.up, seen_from.middle
    own = surfels.centre.median(0).values
    towards = seen_from.eye - (own if middle is None else middle)
    level = towards - (towards @ up) * up
    if middle is None:
        radius = quantile(lambda: [(surfels.centre - own).norm(dim=-1)], WITHIN) or 0.0
        middle, tilt, away = own, math.radians(ELEVATION), max(radius, 1e-6) / math.sin(math.radians(FIELD / 2))
    else:
        tilt, away = math.atan2(float(towards @ up), float(level.norm())), float(towards.norm())
    if level.norm() <= 1e-6 * towards.norm():
        level = torch.linalg.cross(up, X if abs(float(up[0])) < 0.9 else Z)
    forth = normalize(level, dim=0)
    side = torch.linalg.cross(up, forth)
    cameras = []
    for turn in _turns(frames, seen_from.arc):
        level_back = math.cos(turn) * forth + math.sin(turn) * side
        cameras.append(_looking_back(middle, math.cos(tilt) * level_back + math.sin(tilt) * up, up, away, size))
    return cameras


def _turns(frames: int, arc: Tensor | None) -> list[float]:
    """Angles from the eye's, radians: all round, or to and fro within the arc that was seen."""
    if arc is None:
        return [2 * math.pi * frame / frames for frame in range(frames)]
    low, high = arc.tolist()
    middle, half = (high + low) / 2, max((high - low) / 2, 1e-6)
    begun = math.asin(max(-1.0, min(1.0, -middle / half)))
    return [middle + half * math.sin(begun + 2 * math.pi * frame / frames) for frame in range(frames)]


def _looking_back(target: Tensor, back: Tensor, up: Tensor, away: float, size: int) -> Camera:
    right = normalize(torch.linalg.cross(up, back), dim=0)
    pose = torch.eye(4)
    pose[:3, :3] = torch.stack([right, torch.linalg.cross(right, back), -back], -1)
    pose[:3, 3] = target + away * back
    focal = size / 2 / math.tan(math.radians(FIELD / 2))
    return Camera(pose, focal, focal, size / 2, size / 2, size, size)


def pictures(surfels: Surfels, cameras: Sequence[Camera], colour: Colour) -> Iterator[Float[Tensor, "height width 3"]]:
    """Yields the image of each camera, display sRGB on white."""
    for camera in cameras:
        with torch.no_grad():
            seen = splat(camera, surfels, {"colour": _linear(surfels, camera, colour)}, depth_unit=1.0)
            yield srgb_encode(seen.images["colour"] + 1 - seen.alpha[..., None]).clamp(0, 1)


def _linear(surfels: Surfels, camera: Camera, colour: Colour) -> Float[Tensor, "surfels 3"]:
    """The linear colour of each surfel; radiance is taken towards the camera."""
    if colour == "radiance":
        return own_radiance(camera, surfels)
    if colour == "albedo":
        return surfels.albedo
    shown = surfels.frame[..., 2] * 0.5 + 0.5 if colour == "normal" else surfels.roughness[:, None].expand(-1, 3)
    return srgb_decode(shown)
