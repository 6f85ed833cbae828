"""The ranges that R3DG keeps materials in: albedo from 0.03 to 0.8, roughness from 0.09 to 0.99."""

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.surfels.surfels import ROUGHNESS_FLOOR, Surfels

ALBEDO_LEAST, ALBEDO_SPAN = 0.03, 0.77
ROUGHNESS_LEAST, ROUGHNESS_SPAN = 0.09, 0.9

INNERMOST = 0.01
"""Starting values keep this share of the range away from its ends, where a sigmoid has no slope."""


def bounded(learnt: Surfels) -> Surfels:
    """The surfels whose albedo is 0.03 + 0.77 sigmoid and whose roughness is 0.09 + 0.9 sigmoid of the learnt logits.

    What comes out are surfels like any others (``Surfels.albedo``, ``Surfels.roughness``), with gradient to ``learnt``.
    """
    albedo = ALBEDO_LEAST + ALBEDO_SPAN * learnt.albedo_logit.sigmoid()
    roughness = ROUGHNESS_LEAST + ROUGHNESS_SPAN * learnt.roughness_logit.sigmoid()
    share = (roughness - ROUGHNESS_FLOOR) / (1 - ROUGHNESS_FLOOR)
    return replace(learnt, albedo_logit=albedo.logit(), roughness_logit=share.logit())


def learnt_from(surfels: Surfels, albedo: Float[Tensor, "surfels 3"], roughness: Float[Tensor, " surfels"]) -> Surfels:
    """Surfels with logits for which ``bounded`` gives these materials, or the nearest that lie within the ranges."""
    return replace(
        surfels,
        albedo_logit=_logit((albedo - ALBEDO_LEAST) / ALBEDO_SPAN),
        roughness_logit=_logit((roughness - ROUGHNESS_LEAST) / ROUGHNESS_SPAN),
    )


def _logit(share: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    return torch.logit(share.clamp(INNERMOST, 1 - INNERMOST))
