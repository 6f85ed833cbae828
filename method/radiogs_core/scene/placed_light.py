"""A map of distant light, rotated into a world with another upward direction, turned about it and scaled."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from .light import EnvironmentMap, texel_directions


def rotation_to_map(up: Float[Tensor, "3"], turn: float = 0.0) -> Float[Tensor, "3 3"]:
    """The rotation from the world to the axes of a map that is placed in it, float64.

    ``up``, of any length above zero, becomes +Z by the shortest turn (-Z by half a turn about X); then the map is
    turned about it, by ``turn`` degrees counter-clockwise seen from above.
    """
    x, y, z = (up.double().cpu() / up.double().cpu().norm()).tolist()
    if z < -1 + 1e-12:
        upright = torch.diag(torch.tensor([1.0, -1.0, -1.0], dtype=torch.float64))
    else:
        cross = torch.tensor([[0.0, 0.0, -x], [0.0, 0.0, -y], [x, y, 0.0]], dtype=torch.float64)
        upright = torch.eye(3, dtype=torch.float64) + cross + cross @ cross / (1 + z)
    cosine, sine = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    about = torch.tensor([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]], dtype=torch.float64)
    return about @ upright


FINER = 512
"""Maps up to this many rows are turned into one with twice as many, so that a small sun keeps its shape."""


def placed_light(
    light: EnvironmentMap, up: Float[Tensor, "3"], turn: float = 0.0, strength: float = 1.0
) -> tuple[EnvironmentMap, Float[Tensor, "3 3"]]:
    """A map placed in a world where ``up`` is up, resampled to that world's axes, times ``strength``; and its own axes.

    ``turn``: degrees about ``up``, counter-clockwise seen from above. Rows of the second value: the directions in the
    world of the map's +X (its centre column), +Y and +Z (its top). A map that keeps its place keeps its values.
    """
    to_map = rotation_to_map(up, turn)
    if torch.equal(to_map, torch.eye(3, dtype=torch.float64)):
        return (light if strength == 1 else EnvironmentMap(light.radiance * strength)), to_map
    height, width = light.radiance.shape[:2]
    fine = 2 if height <= FINER else 1
    world = texel_directions(fine * height, fine * width)
    turned = light.lookup((world @ to_map.T).to(light.radiance))
    return EnvironmentMap(turned * strength), to_map
