"""Surfels whose metalness may be learnt; GI-GS, which builds on GS-IR, has them too."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.on_surfels.model import LitSurfels, restored_logit
from radiogs_core.on_surfels.start_values import StartValues
from radiogs_core.surfels.stored_tensors import restored_map, restored_surfels


@dataclass(frozen=True)
class MetallicStart(StartValues):
    """Initial materials and light, with a metalness."""

    metallic: float = 0.73
    """Initial metalness, if it is learnt."""


@dataclass(frozen=True)
class MetallicSurfels(LitSurfels):
    """Surfels, a light, and the metalness of each surfel if the variant learns it."""

    metallic_logit: Float[Tensor, " surfels"] | None = None
    """Logit of the metalness; None if the variant does not learn it."""

    @property
    def metallic(self) -> Float[Tensor, " surfels"] | None:
        """Metalness in (0, 1); None if the variant does not learn it."""
        return None if self.metallic_logit is None else torch.sigmoid(self.metallic_logit)

    def tensors(self) -> dict[str, Any]:
        """The model as plain tensors, without gradient history."""
        metal = {} if self.metallic_logit is None else {"metallic_logit": self.metallic_logit.detach()}
        return super().tensors() | metal

    @classmethod
    def of(cls, tensors: Mapping[str, Any]) -> "MetallicSurfels":
        """The inverse of ``tensors``. Raises DataError for tensors of wrong shape or with non-finite values."""
        surfels = restored_surfels(tensors["surfels"])
        return cls(
            surfels, restored_map(tensors, "log_environment"), restored_logit(tensors, "metallic_logit", surfels)
        )
