"""What training recovers: surfels with their materials, and the light that they were seen under."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.surfels.known_surfaces import KnownRadiance
from radiogs_core.surfels.restoring import restored_map, restored_surfels
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.plan import EffectPlan


@dataclass(frozen=True)
class Model:
    """Surfels and the logarithm of the environment's radiance [height, 2 height, 3] (see ``light``).

    ``plan`` is what was simulated when training ended, ``evidence`` the records of the decisions that led to it.
    ``indirect`` is where L_ind under the training light comes from if it was given (``given``).
    """

    surfels: Surfels
    log_environment: Float[Tensor, "height width 3"]
    plan: EffectPlan = field(default_factory=EffectPlan)
    evidence: tuple[Mapping[str, Any], ...] = ()
    indirect: KnownRadiance | None = None

    @property
    def environment(self) -> Float[Tensor, "height width 3"]:
        """Linear radiance of the recovered light; its logarithm is what is learnt, so it is always positive."""
        return self.log_environment.exp()

    def tensors(self) -> dict[str, Any]:
        """The model as plain tensors and values, without gradient history."""
        effects = {"plan": self.plan.state(), "evidence": [dict(each) for each in self.evidence]}
        light = {"log_environment": self.log_environment.detach()}
        given = {} if self.indirect is None else {"indirect": _plain(self.indirect)}
        return {"surfels": self.surfels.plain(), **light, "effects": effects, **given}

    @classmethod
    def of(cls, tensors: Mapping[str, Any]) -> "Model":
        """The inverse of ``tensors``. Raises DataError for what is misshapen or not finite."""
        effects = tensors["effects"]
        return cls(
            restored_surfels(tensors["surfels"]),
            restored_map(tensors, "log_environment"),
            EffectPlan(**effects["plan"]),
            tuple(effects["evidence"]),
            _known(tensors["indirect"]) if "indirect" in tensors else None,
        )


def _plain(known: KnownRadiance) -> dict[str, Any]:
    return {"surfels": known.surfels.parameters(), "residual": known.residual}


def _known(stored: Mapping[str, Any]) -> KnownRadiance:
    return KnownRadiance(restored_surfels(stored["surfels"]), stored["residual"])


def constant_light(height: int, radiance: float, device: torch.device) -> Float[Tensor, "height width 3"]:
    """Log-radiance of a light that is the same from everywhere."""
    return torch.full((height, 2 * height, 3), radiance, device=device).log()
