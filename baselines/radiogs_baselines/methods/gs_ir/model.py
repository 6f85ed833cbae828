"""The model that GS-IR recovers: surfels with materials, distant light, and volumes of occlusion and irradiance."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from .metallic import MetallicSurfels
from .volumes import IrradianceVolume, OcclusionVolume


@dataclass(frozen=True)
class Model(MetallicSurfels):
    """Surfels, a light, and the metalness and volumes that the variant has."""

    occlusion: OcclusionVolume | None = None
    """Baked occlusion; None for a variant without it."""
    irradiance: IrradianceVolume | None = None
    """Learnt indirect irradiance; None for a variant without it."""

    def tensors(self) -> dict[str, Any]:
        """The model as plain tensors, without gradient history."""
        volumes = {"occlusion": self.occlusion, "irradiance": self.irradiance}
        return super().tensors() | {name: volume.tensors() for name, volume in volumes.items() if volume is not None}

    @classmethod
    def of(cls, tensors: Mapping[str, Any]) -> "Model":
        """The inverse of ``tensors``. Raises DataError for tensors of wrong shape or with non-finite values."""
        lit = MetallicSurfels.of(tensors)
        return cls(
            lit.surfels,
            lit.log_environment,
            lit.metallic_logit,
            OcclusionVolume.of(tensors["occlusion"]) if "occlusion" in tensors else None,
            IrradianceVolume.of(tensors["irradiance"]) if "irradiance" in tensors else None,
        )
