"""What R3DG recovers: surfels with their materials, the light from afar, and the light around each surfel."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import softplus

from radiogs_core.surfels.harmonics import COEFFICIENTS
from radiogs_core.surfels.restoring import finite_tensor, require_for_each, restored_map, restored_surfels
from radiogs_core.surfels.surfels import Surfels


@dataclass(frozen=True)
class Model:
    """surfels: with materials within R3DG's ranges (``training.bounded``). local: harmonics of the radiance that
    arrives at each (``local_light``). raw_environment: the environment's radiance before its softplus.
    """

    surfels: Surfels
    local: Float[Tensor, "surfels 16 3"]
    raw_environment: Float[Tensor, "height width 3"]

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
        """The inverse of ``tensors``. Raises DataError for what is misshapen or not finite."""
        surfels, local = restored_surfels(tensors["surfels"]), finite_tensor(tensors, "local")
        require_for_each(surfels, "local", local, (COEFFICIENTS, 3))
        return cls(surfels, local, restored_map(tensors, "raw_environment"))


def before_softplus(radiance: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """x with log(1 + e^x) = ``radiance``, which is above zero; written so that neither small nor large values round."""
    return radiance + torch.log(-torch.expm1(-radiance))
