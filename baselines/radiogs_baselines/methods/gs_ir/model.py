"""The model that GS-IR recovers: surfels with materials, distant light, and volumes of occlusion and irradiance."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.on_surfels.model import LitSurfels, restored_logit
from radiogs_core.surfels.restoring import restored_map, restored_surfels

from .irradiance import IrradianceVolume
from .occlusion import OcclusionVolume


@dataclass(frozen=True)
class Model(LitSurfels):
    """Surfels, a light, and the metalness and volumes that the variant has."""

    metallic_logit: Float[Tensor, " surfels"] | None = None
    """Logit of the metalness; None if the variant does not learn it."""
    occlusion: OcclusionVolume | None = None
    """Baked occlusion; None for a variant without it."""
    irradiance: IrradianceVolume | None = None
    """Learnt indirect irradiance; None for a variant without it."""

    @property
    def metallic(self) -> Float[Tensor, " surfels"] | None:
        """Metalness in (0, 1); None if the variant does not learn it."""
        return None if self.metallic_logit is None else torch.sigmoid(self.metallic_logit)

    def tensors(self) -> dict[str, Any]:
        """The model as plain tensors, without gradient history."""
        found = super().tensors()
        if self.metallic_logit is not None:
            found["metallic_logit"] = self.metallic_logit.detach()
        volumes = {"occlusion": self.occlusion, "irradiance": self.irradiance}
        return found | {name: volume.tensors() for name, volume in volumes.items() if volume is not None}

    @classmethod
    def of(cls, tensors: Mapping[str, Any]) -> "Model":
        """The inverse of ``tensors``. Raises DataError for tensors of wrong shape or with non-finite values."""
        surfels = restored_surfels(tensors["surfels"])
        metallic = restored_logit(tensors, "metallic_logit", surfels)
        return cls(
            surfels,
            restored_map(tensors, "log_environment"),
            metallic,
            OcclusionVolume.of(tensors["occlusion"]) if "occlusion" in tensors else None,
            IrradianceVolume.of(tensors["irradiance"]) if "irradiance" in tensors else None,
        )
