"""The model of RadioGS: surfels with materials, the light of the training views, and the plan of effects."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.on_surfels.model import LitSurfels
from radiogs_core.surfels.known_surfaces import KnownRadiance
from radiogs_core.surfels.stored_tensors import restored_map, restored_surfels
from radiogs_core.transport.plan import EffectPlan


@dataclass(frozen=True)
class Model(LitSurfels):
    """Surfels and a light, with the effects that training simulated and the indirect light that it was given."""

    plan: EffectPlan = field(default_factory=EffectPlan)
    """The effects that were simulated at the end of training."""
    evidence: tuple[Mapping[str, Any], ...] = ()
    """Records of the decisions that led to the plan."""
    indirect: KnownRadiance | None = None
    """Source of L_ind under the training light, if it was given (``oracle``)."""

    def tensors(self) -> dict[str, Any]:
        """The model as plain tensors and values, without gradient history."""
        effects = {"plan": self.plan.state(), "evidence": [dict(each) for each in self.evidence]}
        made = {**super().tensors(), "effects": effects}
        if self.indirect is not None:
            made["indirect"] = {"surfels": self.indirect.surfels.parameters(), "residual": self.indirect.residual}
        return made

    @classmethod
    def of(cls, tensors: Mapping[str, Any]) -> "Model":
        """The inverse of ``tensors``. Raises DataError for a tensor of the wrong shape or with values not finite."""
        effects, given = tensors["effects"], tensors.get("indirect")
        return cls(
            restored_surfels(tensors["surfels"]),
            restored_map(tensors, "log_environment"),
            EffectPlan(**effects["plan"]),
            tuple(effects["evidence"]),
            None if given is None else KnownRadiance(restored_surfels(given["surfels"]), given["residual"]),
        )


def constant_light(height: int, radiance: float, device: torch.device) -> Float[Tensor, "height width 3"]:
    """Log-radiance of a light with the same linear ``radiance`` in all directions."""
    return torch.full((height, 2 * height, 3), radiance, device=device).log()
