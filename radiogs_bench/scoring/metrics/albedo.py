"""Albedo, known up to a factor per channel: its alignment with the true albedo, and differences of colours."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from radiogs_core.scene.colour import srgb_encode

from .conventions import Albedo, Space
from .pictures import SOLID

SMALLEST = 1e-6
"""Predictions are clamped to at least this, so that ratios stay finite; the median is not affected."""

PER_CHANNEL_MEDIAN = Albedo()
"""Median of the ratios over the covered pixels of all views, per channel."""

SUBSET = 20
"""Number of views in TensoIR's alignment, at equal stride."""

Image = Float[Tensor, "height width 3"]
Mask = Float[Tensor, "height width 1"]
Pixels = Bool[Tensor, "height width"]

PIXELS: Mapping[str, Callable[[Image, Image, Mask], Pixels]] = {
    "solid": lambda prediction, truth, mask: (mask[..., 0] > 0.5) & (truth > 0).all(-1),
    "covered": lambda prediction, truth, mask: (mask[..., 0] > 0) & (truth > 0).all(-1),
    "covered, any truth": lambda prediction, truth, mask: mask[..., 0] > 0,
    "predicted": lambda prediction, truth, mask: (prediction > 0).all(-1),
}
"""The pixels that count for the factor, by the convention's name."""

FACTORS: Mapping[str, Callable[[Tensor], Tensor]] = {
    "median": lambda ratios: ratios.median(0).values,
    "first channel's median": lambda ratios: ratios[:, 0].median().expand(3).clone(),
    "mean": lambda ratios: ratios.mean(0),
}
"""The factor from the ratios [pixels, 3], by the convention's name."""


def albedo_scale(
    predictions: Sequence[Image], truths: Sequence[Image], masks: Sequence[Mask], rules: Albedo = PER_CHANNEL_MEDIAN
) -> Float[Tensor, "3"]:
    """Factor per channel from predictions to truths (linear), over the rules' views and pixels; ones without pixels."""
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
    """Indices of the views that the factor is fitted to."""
    if rules.fitted_to == "first view":
        return [0] if count else []
    if rules.fitted_to == "20 views" and count > SUBSET:
        return [index * (count // SUBSET) for index in range(SUBSET)]
    return list(range(count))


def least_squares(
    prediction: Float[Tensor, "pixels channels"], truth: Float[Tensor, "pixels channels"]
) -> Float[Tensor, " channels"]:
    """The s per channel that minimises |truth - s prediction|^2; zero for a prediction of zero."""
    prediction, truth = prediction.double(), truth.double()
    square = prediction.square().sum(0)
    return torch.where(square > 0, (truth * prediction).sum(0) / torch.where(square > 0, square, 1.0), 0.0).float()


def encoded(linear: Image, space: Space) -> Image:
    """Linear albedo in the space in which it is compared; negative values count as zero under a pure power."""
    if space == "srgb":
        return srgb_encode(linear)
    return linear.clamp(min=0) ** (1 / 2.2) if space == "gamma 2.2" else linear


TO_XYZ = ((0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505))
"""CIE XYZ of linear sRGB (IEC 61966-2-1)."""


def ciede2000(ours: Image, theirs: Image, mask: Mask) -> float:
    """Mean CIEDE2000 of two linear sRGB images where the mask covers more than half; NaN if no pixel counts.

    A surface of albedo 1 is white under D65 (L* = 100). 1 is about what an eye can tell apart; black against white is
    100. By colour-science (CIE 142-2001, Sharma et al. 2005).
    """
    inside = mask[..., 0] > SOLID
    if not inside.any():
        return float("nan")
    with np.printoptions():  # the import changes how numpy prints numbers, and so the digits in CSV files
        import colour  # slow, and only protocols that ask for it need it

    to_xyz = torch.tensor(TO_XYZ, dtype=torch.float64)
    white = to_xyz.sum(1)

    def lab(linear: Float[Tensor, "pixels 3"]) -> Float[np.ndarray, "pixels 3"]:
        xyz = linear.clamp(0, 1).double() @ to_xyz.T
        return np.asarray(colour.XYZ_to_Lab(xyz.numpy(), (white[:2] / white.sum()).numpy()))

    return float(np.mean(colour.delta_E(lab(theirs[inside]), lab(ours[inside]), method="CIE 2000")))
