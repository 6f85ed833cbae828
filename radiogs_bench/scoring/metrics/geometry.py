"""Metrics of geometry: the angle between normals, and Stanford-ORB's scale-invariant error of depth maps."""

import math
from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import normalize

from .conventions import Depth, DepthOffset, Normal
from .pictures import in_bits

IN_MASK = Normal()
"""Normal errors averaged where the truth covers more than half of a pixel."""

HOLE = 90.0
"""Error in degrees of a missing (zero) prediction inside the mask: the mean error of a random direction."""

BEHIND = (0.0, 0.0, 1.0)
"""The normal that published evaluations give to the background, on both sides."""


def normal_mae(
    normal: Float[Tensor, "height width 3"],
    target: Float[Tensor, "height width 3"],
    mask: Float[Tensor, "height width 1"],
    alpha: Float[Tensor, "height width 1"] | None = None,
    rules: Normal = IN_MASK,
) -> float:
    """Mean angle in degrees over the region of the rules; NaN if the mask is empty. Lengths do not matter.

    ``mask`` is the true and ``alpha`` the predicted coverage (the true one if not given); normals are directions in one
    frame, zero where there are none; pixels without a true one are left out.
    """
    # A hole stays a hole: written as (n + 1) / 2 it would come back as grey, which is no direction either.
    missing = (normal == 0).all(-1, keepdim=True)
    if rules.prediction_bits != "float":
        normal = torch.where(missing, 0.0, 2 * in_bits((normal + 1) / 2, rules.prediction_bits) - 1)
    inside = (mask[..., 0] > 0.5) & (target != 0).any(-1)  # without a true direction there is no error
    if rules.region == "image":
        own = mask if alpha is None else alpha
        blended_by = mask if rules.blended_by == "true coverage" else own
        ours = over_background(normal, blended_by, own if rules.lengths == "own coverage" else 1.0)
        normal, target = ours, over_background(target, mask)
        return float(angle(normal, target).mean()) if inside.any() else math.nan
    return float(angle(normal[inside], target[inside]).mean())


def angle(a: Float[Tensor, "*pixels 3"], b: Float[Tensor, "*pixels 3"]) -> Float[Tensor, "*pixels"]:
    """Degrees between directions, in float64; HOLE where either is zero.

    atan2(|a x b|, a . b) is exact at every angle; arccos of a float32 dot product returns 0 or NaN near 0 degrees.
    """
    a, b = a.double(), b.double()
    degrees = torch.atan2(torch.linalg.cross(a, b).norm(dim=-1), (a * b).sum(-1)) * (180 / math.pi)
    missing = (a == 0).all(-1) | (b == 0).all(-1)
    return torch.where(missing, HOLE, degrees)


def over_background(
    normal: Float[Tensor, "height width 3"],
    coverage: Float[Tensor, "height width 1"],
    lengths: Float[Tensor, "height width 1"] | float = 1.0,
) -> Float[Tensor, "height width 3"]:
    """Normals blended over (0, 0, 1): length coverage n + (1 - coverage) (0, 0, 1), none outside the coverage."""
    behind = torch.tensor(BEHIND, dtype=normal.dtype, device=normal.device)
    return torch.where(coverage > 0, normalize(normal, dim=-1) * lengths * coverage, 0.0) + behind * (1 - coverage)


Map = Float[Tensor, "height width 1"]

ONE_SCALE = Depth()
"""One factor for all views of a capture."""


def depth_errors(
    depths: Sequence[Map], targets: Sequence[Map], masks: Sequence[Map], rules: Depth = ONE_SCALE
) -> list[float]:
    """Mean squared error of each view's z-depth after the least-squares factor; NaN where its mask is empty.

    The mean is over the whole frame, with zeros outside the mask, as the benchmark has it; world units squared.
    ``masks`` count where they are above one half.
    """
    pairs = [(depth[mask > 0.5].double(), target[mask > 0.5].double())
             for depth, target, mask in zip(depths, targets, masks, strict=True)]  # fmt: skip
    if rules.scale == "all views":
        scales = [_factor(torch.cat([ours for ours, _ in pairs]), torch.cat([theirs for _, theirs in pairs]))]
        scales *= len(pairs)
    else:
        scales = [_factor(*pair) for pair in pairs]
    return [
        float((scale * ours - theirs).square().sum()) / mask.numel() if len(ours) else math.nan
        for scale, (ours, theirs), mask in zip(scales, pairs, masks, strict=True)
    ]


def depth_offset(depth: Map, target: Map, mask: Map, extent: float, rules: DepthOffset) -> float:
    """Mean |z - z*| in percent of ``extent`` (world units); NaN where nothing is covered.

    A pixel that the prediction leaves empty has depth 0, an error of the whole distance. A pixel with true depth 0 has
    unknown depth and does not count.
    """
    inside = (mask > rules.covered) & (target > 0)
    difference = (depth[inside].double() - target[inside].double()).abs()
    return 100 * float(difference.mean()) / extent if len(difference) else math.nan


def _factor(ours: Float[Tensor, " pixels"], theirs: Float[Tensor, " pixels"]) -> float:
    square = float(ours.square().sum())
    return float((ours * theirs).sum()) / square if square > 0 else 0.0
