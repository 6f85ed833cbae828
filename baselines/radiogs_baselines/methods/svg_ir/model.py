"""The model that SVG-IR recovers: materials and normals at surfel vertices, a light, and the radiance ratio."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import normalize

from radiogs_core.surfels.stored_tensors import finite_tensor, require_for_each, restored_map, restored_surfels
from radiogs_core.surfels.surfels import ROUGHNESS_FLOOR, Surfels

VERTEX = ("vertex_albedo_logit", "vertex_roughness_logit", "vertex_offset")
"""Names of the raw parameters of vertices."""

LEARNT = (*VERTEX, "log_environment", "ratio")
"""Names of all raw parameters that are not the surfels'."""


@dataclass(frozen=True)
class Model:
    """Surfels, raw parameters of their vertices, and the light."""

    surfels: Surfels
    """Surfels at the current iteration; their own albedo and roughness are unused."""
    cached: Surfels
    """Surfels of stage 1, from which the table of incident light is traced."""
    vertex_albedo_logit: Float[Tensor, "surfels vertices 3"]
    """Logits of the vertices' albedo."""
    vertex_roughness_logit: Float[Tensor, "surfels vertices"]
    """Logits of the vertices' roughness."""
    vertex_offset: Float[Tensor, "surfels vertices 3"]
    """Offsets added to the surfel's unit normal before normalisation, world axes."""
    log_environment: Float[Tensor, "height width 3"]
    """Log-radiance of the environment map (see ``scene.light``)."""
    ratio: Float[Tensor, ""]
    """Factor on the radiance of all entries of the table."""

    @property
    def albedo(self) -> Float[Tensor, "surfels vertices 3"]:
        """Linear diffuse albedo in (0, 1)."""
        return self.vertex_albedo_logit.sigmoid()

    @property
    def roughness(self) -> Float[Tensor, "surfels vertices"]:
        """Perceptual roughness r in (ROUGHNESS_FLOOR, 1)."""
        return ROUGHNESS_FLOOR + (1 - ROUGHNESS_FLOOR) * self.vertex_roughness_logit.sigmoid()

    @property
    def normal(self) -> Float[Tensor, "surfels vertices 3"]:
        """Unit shading normals, world axes."""
        return normalize(self.surfels.frame[:, None, :, 2] + self.vertex_offset, dim=-1)

    @property
    def environment(self) -> Float[Tensor, "height width 3"]:
        """Linear radiance of the recovered light."""
        return self.log_environment.exp()

    def tensors(self) -> dict[str, Any]:
        """The model as plain tensors, without gradient history."""
        learnt = {name: getattr(self, name).detach() for name in LEARNT}
        return learnt | {"surfels": self.surfels.plain(), "cached": self.cached.plain()}

    @classmethod
    def of(cls, tensors: Mapping[str, Any]) -> "Model":
        """The inverse of ``tensors``. Raises DataError for tensors of wrong shape or with non-finite values."""
        surfels, learnt = restored_surfels(tensors["surfels"]), {name: finite_tensor(tensors, name) for name in LEARNT}
        vertices = learnt["vertex_roughness_logit"].shape[-1:]
        for name, rest in ((VERTEX[0], (*vertices, 3)), (VERTEX[1], vertices), (VERTEX[2], (*vertices, 3))):
            require_for_each(surfels, name, learnt[name], rest)
        restored_map(tensors, "log_environment")
        return cls(surfels, restored_surfels(tensors["cached"]), **learnt)

    def averaged(self) -> Surfels:
        """Surfels whose material is the mean over their vertices: mean albedo, mean logit of roughness."""
        logit = torch.logit(self.albedo.mean(1))
        return replace(self.surfels, albedo_logit=logit, roughness_logit=self.vertex_roughness_logit.mean(1))
