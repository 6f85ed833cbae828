"""The model that GI-GS recovers: surfels with materials, and the light of the training images."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.on_surfels.model import LitSurfels, restored_logit
from radiogs_core.surfels.restoring import restored_map, restored_surfels


@dataclass(frozen=True)
class Model(LitSurfels):
    """Surfels, a light, and the metalness of each surfel if the variant learns it."""

    metallic_logit: Float[Tensor, " surfels"] | None = None
    """Logit of the metalness; None if the variant does not learn it."""

    @property
    def metallic(self) -> Float[Tensor, " surfels"]:
        """Metalness in [0, 1]; 0 if the variant does not learn it."""
        if self.metallic_logit is None:
            return torch.zeros_like(self.surfels.roughness_logit)
        return self.metallic_logit.sigmoid()

    def tensors(self) -> dict[str, Any]:
        """The model as plain tensors, without gradient history."""
        metal = {} if self.metallic_logit is None else {"metallic_logit": self.metallic_logit.detach()}
        return super().tensors() | metal

    @classmethod
    def of(cls, tensors: Mapping[str, Any]) -> "Model":
        """The inverse of ``tensors``. Raises DataError for tensors of wrong shape or with non-finite values."""
        surfels = restored_surfels(tensors["surfels"])
        metallic = restored_logit(tensors, "metallic_logit", surfels)
        return cls(surfels, restored_map(tensors, "log_environment"), metallic)
