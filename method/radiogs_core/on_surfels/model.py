"""The model that a method on surfels recovers: surfels with their materials, and the light of the training views."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from ..surfels.stored_tensors import finite_tensor, require_for_each, restored_map, restored_surfels
from ..surfels.surfels import Surfels


@runtime_checkable
class SurfelModel(Protocol):
    """Surfels and the light of the training views, in any parametrisation."""

    @property
    def surfels(self) -> Surfels:
        """The surfels with their materials."""

    @property
    def environment(self) -> Float[Tensor, "height width 3"]:
        """Linear radiance of the light, latitude-longitude (see ``scene.light``)."""

    def tensors(self) -> dict[str, Any]:
        """The model as plain tensors and values, without gradient history."""


@dataclass(frozen=True)
class LitSurfels:
    """Surfels under an environment map whose logarithm is learnt."""

    surfels: Surfels
    """The surfels with their materials."""
    log_environment: Float[Tensor, "height width 3"]
    """Logarithm of the environment's linear radiance, [height, 2 height, 3] (see ``scene.light``)."""

    @property
    def environment(self) -> Float[Tensor, "height width 3"]:
        """Linear radiance of the recovered light. It is always positive, because its logarithm is learnt.

        It is computed once, and once more for readers with gradient if it was first read without: a step whose L_rad
        has no weight reads it without.
        """
        kept: dict[bool, Tensor] = self.__dict__.setdefault("_environments", {})
        with_gradient = torch.is_grad_enabled()
        if with_gradient not in kept:
            kept[with_gradient] = self.log_environment.exp()
        return kept[with_gradient]

    def tensors(self) -> dict[str, Any]:
        """The model as plain tensors and values, without gradient history."""
        return {"surfels": self.surfels.plain(), "log_environment": self.log_environment.detach()}

    @classmethod
    def of(cls, tensors: Mapping[str, Any]) -> "LitSurfels":
        """The inverse of ``tensors``. Raises DataError for a tensor of the wrong shape or with values not finite."""
        return cls(restored_surfels(tensors["surfels"]), restored_map(tensors, "log_environment"))


def restored_logit(tensors: Mapping[str, Any], name: str, surfels: Surfels) -> Float[Tensor, " surfels"] | None:
    """A stored logit for each surfel, or None if it was not learnt. Raises DataError as ``LitSurfels.of`` does."""
    if name not in tensors:
        return None
    logit = finite_tensor(tensors, name)
    require_for_each(surfels, name, logit, ())
    return logit
