"""The model that R3DG recovers: surfels with materials, distant light, and a local light of each surfel."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import softplus

from radiogs_core.surfels.harmonics import COEFFICIENTS
from radiogs_core.surfels.stored_tensors import finite_tensor, require_for_each, restored_map, restored_surfels
from radiogs_core.surfels.surfels import Surfels


@dataclass(frozen=True)
class Model:
    """Surfels, distant light and local light."""

    surfels: Surfels
    """Surfels with materials within R3DG's ranges (``training.bounded``)."""
    local: Float[Tensor, "surfels 16 3"]
    """Harmonics of the local radiance that arrives at each surfel, linear RGB (``incident.local_radiance``)."""
    raw_environment: Float[Tensor, "height width 3"]
    """Radiance of the environment map before its softplus."""

    @property
    def environment(self) -> Float[Tensor, "height width 3"]:
        """Linear radiance of the recovered light, [height, 2 height, 3] (see ``scene.light``)."""
        return softplus(self.raw_environment)

    def tensors(self) -> dict[str, Any]:
        """The model as plain tensors, without gradient history."""
        further = {"local": self.local.detach(), "raw_environment": self.raw_environment.detach()}
        return {"surfels": self.surfels.plain(), **further}

    @classmethod
    def of(cls, tensors: Mapping[str, Any]) -> "Model":
        """The inverse of ``tensors``. Raises DataError for tensors of wrong shape or with non-finite values."""
        surfels, local = restored_surfels(tensors["surfels"]), finite_tensor(tensors, "local")
        require_for_each(surfels, "local", local, (COEFFICIENTS, 3))
        return cls(surfels, local, restored_map(tensors, "raw_environment"))


def before_softplus(radiance: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """Inverse softplus: x with log(1 + e^x) = ``radiance`` > 0, in a form accurate for small and large values."""
    return radiance + torch.log(-torch.expm1(-radiance))
