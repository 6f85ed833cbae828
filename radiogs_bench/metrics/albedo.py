"""Aligning recovered albedo with the true one: light and albedo are known only up to a factor per channel."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

SMALLEST = 1e-6
"""Predictions below this are taken for it, so that a ratio stays finite; the median does not feel them."""


def albedo_scale(
    predictions: Sequence[Float[Tensor, "height width 3"]],
    truths: Sequence[Float[Tensor, "height width 3"]],
    masks: Sequence[Float[Tensor, "height width 1"]],
) -> Float[Tensor, "3"]:
    """Per channel, the median over all views' covered pixels of truth / prediction (linear; IRGS, RadioGS, TensoIR).

    Pixels count where the mask covers more than half and the truth is positive in all channels. Ones where there are
    no such pixels.
    """
    ratios = []
    for prediction, truth, mask in zip(predictions, truths, masks, strict=True):
        inside = (mask[..., 0] > 0.5) & (truth > 0).all(-1)
        ratios.append(truth[inside] / prediction[inside].clamp(min=SMALLEST))
    everything = torch.cat(ratios)
    return everything.median(0).values if len(everything) else torch.ones(3)
