"""What an ablation changes: every row of the paper's ablations is a value of these fields, not a code path."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Variant:
    """A method variant; the defaults are the full method.

    radiometric_weight: lambda_rad of the inverse-rendering stage (paper: 0.2).
    detach: which side of the residual L_G - L_PBR gets no gradient: none, "pbr" (L_PBR) or "surfel" (L_G).
    initialise: stage 1 with the simplified radiometric consistency, or by novel-view synthesis alone ("nvs").
    view_share: share of the training views that both stages may see, in (0, 1].
    """

    radiometric_weight: float = 0.2
    detach: Literal["none", "pbr", "surfel"] = "none"
    initialise: Literal["radiometric", "nvs"] = "radiometric"
    view_share: float = 1.0
