"""Error of a recovered environment map."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.errors import UsageError
from radiogs_core.scene.light import texel_solid_angles

from .conventions import Environment

UNSCALED = Environment("none")
"""No alignment: the recovered light is compared unscaled."""


def environment_error(
    estimate: Float[Tensor, "height width 3"],
    truth: Float[Tensor, "rows columns 3"],
    rules: Environment = UNSCALED,
) -> float:
    """Squared error over the squared truth, both integrated over solid angle; 0 is exact, 1 a black estimate.

    Both maps are linear latitude-longitude radiance in one frame and size. With a scale the least-squares factor is
    applied first, because light is known only up to a factor per channel; the error is then 1 - cos^2 of the maps'
    angle and at most 1. NaN for a truth that is black. Raises UsageError for maps of different sizes.
    """
    if estimate.shape != truth.shape:
        raise UsageError(
            f"environment maps of {tuple(estimate.shape)} and {tuple(truth.shape)} cannot be compared",
            "Every texel needs its partner.",
            "Resample one of them first.",
        )
    weight = texel_solid_angles(*truth.shape[:2], dtype=torch.float64)[..., None]
    ours, theirs = estimate.double().cpu(), truth.double().cpu()
    dimensions = (0, 1) if rules.scale == "factor a channel" else (0, 1, 2)
    if rules.scale != "none":
        square = (weight * ours.square()).sum(dimensions)
        product = (weight * ours * theirs).sum(dimensions)
        ours = ours * torch.where(square > 0, product / torch.where(square > 0, square, 1.0), 0.0)
    power = float((weight * theirs.square()).sum())
    return float((weight * (ours - theirs).square()).sum()) / power if power > 0 else math.nan
