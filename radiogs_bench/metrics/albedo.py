"""Aligning recovered albedo with the true one: light and albedo are known only up to a factor per channel."""

from collections.abc import Callable, Mapping, Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from radiogs_core.scene.colour import srgb_encode

from .conventions import Albedo, Space

SMALLEST = 1e-6
"""Predictions below this are taken for it, so that a ratio stays finite; the median does not feel them."""

PER_CHANNEL_MEDIAN = Albedo()
"""Over the covered pixels of all views."""

SUBSET = 20
"""Views that TensoIR's alignment looks at, at equal stride."""

Image = Float[Tensor, "height width 3"]
Mask = Float[Tensor, "height width 1"]
Pixels = Bool[Tensor, "height width"]

PIXELS: Mapping[str, Callable[[Image, Image, Mask], Pixels]] = {
    "solid": lambda prediction, truth, mask: (mask[..., 0] > 0.5) & (truth > 0).all(-1),
    "covered": lambda prediction, truth, mask: (mask[..., 0] > 0) & (truth > 0).all(-1),
    "covered, any truth": lambda prediction, truth, mask: mask[..., 0] > 0,
    "predicted": lambda prediction, truth, mask: (prediction > 0).all(-1),
}
"""Which pixels count, by the convention's word."""

FACTORS: Mapping[str, Callable[[Tensor], Tensor]] = {
    "median": lambda ratios: ratios.median(0).values,
    "first channel's median": lambda ratios: ratios[:, 0].median().expand(3).clone(),
    "mean": lambda ratios: ratios.mean(0),
}
"""What is taken from the ratios [pixels, 3], by the convention's word."""


def albedo_scale(
    predictions: Sequence[Image], truths: Sequence[Image], masks: Sequence[Mask], rules: Albedo = PER_CHANNEL_MEDIAN
) -> Float[Tensor, "3"]:
    """Factor per channel that takes the predictions to the truths, over the views and pixels of the rules (linear).

    Ones where there are no such pixels, or nothing is to be aligned.
    """
    if rules.align == "none":
        return torch.ones(3)
    kept = fitted_views(len(truths), rules)
    ours, theirs = [], []
    for prediction, truth, mask in ((predictions[view], truths[view], masks[view]) for view in kept):
        inside = PIXELS[rules.pixels](prediction, truth, mask)
        ours.append(prediction[inside])
        theirs.append(truth[inside])
    if not any(map(len, ours)):
        return torch.ones(3)
    prediction, truth = torch.cat(ours), torch.cat(theirs)
    if rules.align == "least squares":
        return least_squares(prediction, truth)
    ratios = truth / prediction.clamp(min=SMALLEST)
    if rules.largest is not None:
        ratios = ratios.clamp(SMALLEST, rules.largest)
    return FACTORS[rules.align](ratios)


def fitted_views(count: int, rules: Albedo) -> list[int]:
    """Places of the views that the factor is fitted to."""
    if rules.fitted_to == "first view":
        return [0] if count else []
    if rules.fitted_to == "20 views" and count > SUBSET:
        return [place * (count // SUBSET) for place in range(SUBSET)]
    return list(range(count))


def least_squares(
    prediction: Float[Tensor, "pixels channels"], truth: Float[Tensor, "pixels channels"]
) -> Float[Tensor, " channels"]:
    """The s of each channel that minimises |truth - s prediction|^2; zero for a prediction that is zero."""
    prediction, truth = prediction.double(), truth.double()
    square = prediction.square().sum(0)
    return torch.where(square > 0, (truth * prediction).sum(0) / torch.where(square > 0, square, 1.0), 0.0).float()


def encoded(linear: Image, space: Space) -> Image:
    """Linear albedo in the space that it is compared in; negative values count as zero under a pure power."""
    if space == "srgb":
        return srgb_encode(linear)
    return linear.clamp(min=0) ** (1 / 2.2) if space == "gamma 2.2" else linear
