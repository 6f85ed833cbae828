"""Cameras around the origin, and the depth maps of solids that they see."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.camera import Camera

Depth = Float[Tensor, "height width"]


def looking_at_origin(direction: Float[Tensor, "3"], distance: float = 4.0, size: int = 160) -> Camera:
    forward = -direction / direction.norm()
    up = torch.tensor([0.0, 0.0, 1.0] if abs(float(forward[2])) < 0.9 else [0.0, 1.0, 0.0], dtype=torch.float64)
    right = torch.linalg.cross(forward, up)
    right = right / right.norm()
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3, :3] = torch.stack([right, torch.linalg.cross(forward, right), forward], -1)
    pose[:3, 3] = -distance * forward
    return Camera(pose, 1.3 * size, 1.3 * size, size / 2, size / 2, size, size)


def all_around(count: int = 40) -> list[Camera]:
    place = torch.arange(count, dtype=torch.float64)
    height = 1 - (2 * place + 1) / count
    turn = place * math.pi * (3 - math.sqrt(5))
    side = (1 - height.square()).sqrt()
    return [looking_at_origin(each) for each in torch.stack([side * turn.cos(), side * turn.sin(), height], -1)]


def depth_of_sphere(camera: Camera, radius: float, middle: Float[Tensor, "3"] | None = None) -> Depth:
    """Z-depth of the first hit; zero where there is none. ``middle``: its centre (None: the origin)."""
    rays, eye = camera.ray_directions(), camera.centre if middle is None else camera.centre - middle
    a, b = rays.square().sum(-1), rays @ eye
    under_root = b.square() - a * (eye.square().sum() - radius**2)
    return torch.where(under_root > 0, (-b - under_root.clamp(min=0).sqrt()) / a, 0.0)


def depth_of_box(camera: Camera, low: Tensor, high: Tensor) -> Depth:
    rays = camera.ray_directions()
    sides = torch.stack([(low - camera.centre) / rays, (high - camera.centre) / rays])
    enters, leaves = sides.amin(0).amax(-1), sides.amax(0).amin(-1)
    return torch.where((leaves > enters) & (enters > 0), enters, 0.0)
