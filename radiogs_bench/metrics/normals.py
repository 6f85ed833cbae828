"""Angle between predicted and true normals."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

HOLE = 90.0
"""Degrees that a missing (zero) prediction inside the mask counts: no direction is as wrong as a guess."""


def normal_mae(
    normal: Float[Tensor, "height width 3"],
    target: Float[Tensor, "height width 3"],
    mask: Float[Tensor, "height width 1"],
) -> float:
    """Mean angle in degrees over the pixels that the mask covers by more than half; NaN if there are none.

    atan2(|a x b|, a . b) is exact at every angle; arccos of a float32 dot product returns 0 or NaN near 0 degrees.
    Lengths do not matter.
    """
    inside = mask[..., 0] > 0.5
    a, b = normal[inside].double(), target[inside].double()
    angle = torch.atan2(torch.linalg.cross(a, b).norm(dim=-1), (a * b).sum(-1)) * (180 / math.pi)
    missing = (a == 0).all(-1) | (b == 0).all(-1)
    return float(torch.where(missing, HOLE, angle).mean())
