"""What GS-IR recovers: surfels with their materials, the light from afar, and the two volumes around the surfels."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.surfels.restoring import finite_tensor, require_for_each, restored_map, restored_surfels
from radiogs_core.surfels.surfels import Surfels

from .irradiance import IrradianceVolume
from .occlusion import OcclusionVolume


@dataclass(frozen=True)
class Model:
    """log_environment: logarithm of the environment's radiance (see ``scene.light``). metallic_logit, occlusion and
    irradiance: None where the variant has none.
    """

    surfels: Surfels
    log_environment: Float[Tensor, "height width 3"]
    metallic_logit: Float[Tensor, " surfels"] | None = None
    occlusion: OcclusionVolume | None = None
    irradiance: IrradianceVolume | None = None

    @property
    def environment(self) -> Float[Tensor, "height width 3"]:
        """Linear radiance of the recovered light."""
        return self.log_environment.exp()

    @property
    def metallic(self) -> Float[Tensor, " surfels"] | None:
        """Metalness in (0, 1)."""
        return None if self.metallic_logit is None else torch.sigmoid(self.metallic_logit)

    def tensors(self) -> dict[str, Any]:
        """The model as plain tensors, without gradient history."""
        found: dict[str, Any] = {"surfels": self.surfels.plain(), "log_environment": self.log_environment.detach()}
        if self.metallic_logit is not None:
            found["metallic_logit"] = self.metallic_logit.detach()
        volumes = {"occlusion": self.occlusion, "irradiance": self.irradiance}
        return found | {name: volume.tensors() for name, volume in volumes.items() if volume is not None}

    @classmethod
    def of(cls, tensors: Mapping[str, Any]) -> "Model":
        """The inverse of ``tensors``. Raises DataError for what is misshapen or not finite."""
        surfels, metallic = restored_surfels(tensors["surfels"]), None
        if "metallic_logit" in tensors:
            metallic = finite_tensor(tensors, "metallic_logit")
            require_for_each(surfels, "metallic_logit", metallic, ())
        return cls(
            surfels,
            restored_map(tensors, "log_environment"),
            metallic,
            OcclusionVolume.of(tensors["occlusion"]) if "occlusion" in tensors else None,
            IrradianceVolume.of(tensors["irradiance"]) if "irradiance" in tensors else None,
        )
