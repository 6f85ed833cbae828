"""The model that TensoIR recovers: a field, and the light of the training images."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch

from .box import Box
from .field import Field
from .light import SphericalGaussians

LIGHT = "light"
"""Name of the light among the learnt parameters; all others belong to the field."""


@dataclass(frozen=True)
class Model:
    """A field and a distant light."""

    field: Field
    """Density, radiance, normals and materials."""
    light: SphericalGaussians
    """The recovered light."""

    def tensors(self) -> dict[str, Any]:
        """The model as plain values, without gradient history."""
        parameters = {name: value.detach() for name, value in self.field.parameters.items()}
        return {"box": self.field.box.tensors(), "parameters": parameters, LIGHT: self.light.raw.detach()}

    @classmethod
    def of(cls, tensors: Mapping[str, Any], device: torch.device) -> "Model":
        """The inverse of ``tensors``, with tensors on ``device``."""
        parameters = {name: value.to(device) for name, value in tensors["parameters"].items()}
        field = Field(Box.of(tensors["box"], device), parameters)
        return cls(field, SphericalGaussians(tensors[LIGHT].to(device)))
