"""Scale-invariant error of depth maps, as Stanford-ORB scores geometry."""

import math
from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from .conventions import Depth, DepthOffset

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
    pairs = [_inside(*view) for view in zip(depths, targets, masks, strict=True)]
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

    A pixel that the prediction leaves empty has depth 0: it counts as that, an error of the whole distance.
    """
    inside = mask > rules.covered
    difference = (depth[inside].double() - target[inside].double()).abs()
    return 100 * float(difference.mean()) / extent if len(difference) else math.nan


def _inside(depth: Map, target: Map, mask: Map) -> tuple[Float[Tensor, " pixels"], Float[Tensor, " pixels"]]:
    inside = mask > 0.5
    return depth[inside].double(), target[inside].double()


def _factor(ours: Float[Tensor, " pixels"], theirs: Float[Tensor, " pixels"]) -> float:
    square = float(ours.square().sum())
    return float((ours * theirs).sum()) / square if square > 0 else 0.0
