"""What IRGS recovers: surfels with their materials, and the light that they were seen under."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from jaxtyping import Float
from torch import Tensor

from radiogs_core.surfels.restoring import restored_map, restored_surfels
from radiogs_core.surfels.surfels import Surfels


@dataclass(frozen=True)
class Model:
    """Surfels and the logarithm of the environment's radiance [height, 2 height, 3] (see ``scene.light``)."""

    surfels: Surfels
    log_environment: Float[Tensor, "height width 3"]

    @property
    def environment(self) -> Float[Tensor, "height width 3"]:
        """Linear radiance of the recovered light."""
        return self.log_environment.exp()

    def tensors(self) -> dict[str, Any]:
        """The model as plain tensors, without gradient history."""
        return {"surfels": self.surfels.plain(), "log_environment": self.log_environment.detach()}

    @classmethod
    def of(cls, tensors: Mapping[str, Any]) -> "Model":
        """The inverse of ``tensors``. Raises DataError for what is misshapen or not finite."""
        return cls(restored_surfels(tensors["surfels"]), restored_map(tensors, "log_environment"))
