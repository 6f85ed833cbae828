"""What GI-GS recovers: surfels with their materials, and the light that they were seen under."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.surfels.restoring import finite_tensor, require_for_each, restored_map, restored_surfels
from radiogs_core.surfels.surfels import Surfels


@dataclass(frozen=True)
class Model:
    """Surfels and the logarithm of the environment's radiance [height, 2 height, 3] (see ``scene.light``).

    metallic_logit: of the share of metal; None where none is learnt.
    """

    surfels: Surfels
    log_environment: Float[Tensor, "height width 3"]
    metallic_logit: Float[Tensor, " surfels"] | None = None

    @property
    def environment(self) -> Float[Tensor, "height width 3"]:
        """Linear radiance of the recovered light."""
        return self.log_environment.exp()

    @property
    def metallic(self) -> Float[Tensor, " surfels"]:
        """Share of metal in [0, 1]; 0 where none is learnt."""
        if self.metallic_logit is None:
            return torch.zeros_like(self.surfels.roughness_logit)
        return self.metallic_logit.sigmoid()

    @property
    def further(self) -> dict[str, Tensor]:
        """What is learnt beside the surfels, by name."""
        metal = {} if self.metallic_logit is None else {"metallic_logit": self.metallic_logit}
        return {"log_environment": self.log_environment, **metal}

    def tensors(self) -> dict[str, Any]:
        """The model as plain tensors, without gradient history."""
        return {"surfels": self.surfels.plain(), **{name: value.detach() for name, value in self.further.items()}}

    @classmethod
    def of(cls, tensors: Mapping[str, Any]) -> "Model":
        """The inverse of ``tensors``. Raises DataError for what is misshapen or not finite."""
        surfels, metallic = restored_surfels(tensors["surfels"]), None
        if "metallic_logit" in tensors:
            metallic = finite_tensor(tensors, "metallic_logit")
            require_for_each(surfels, "metallic_logit", metallic, ())
        return cls(surfels, restored_map(tensors, "log_environment"), metallic)
