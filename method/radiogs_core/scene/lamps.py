"""Lamps without size, as glTF's KHR_lights_punctual has them: point lamps, spot lamps and suns.

World units count as metres. A white diffuse surface that faces an irradiance of pi has the radiance 1, which images
show as white.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import normalize

from ..errors import UsageError
from ..plain_values import require

Vector = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Lamp(ABC):
    """A lamp without size. Raises UsageError for a negative intensity or colour."""

    intensity: float = math.pi
    """Radiant intensity of point and spot lamps, W/sr; irradiance of what faces a sun, W/m^2."""
    colour: Vector = (1.0, 1.0, 1.0)
    """Factor of the intensity for each channel, linear RGB."""

    def __post_init__(self) -> None:
        require(self, "zero or above", "intensity", "colour")

    @abstractmethod
    def light_at(self, points: Float[Tensor, "points 3"]) -> tuple[Tensor, Tensor, Tensor]:
        """Unit direction from each world point to the lamp [points, 3], distance [points], and irradiance at normal
        incidence without blockers [points, 3], linear RGB; infinite at the lamp itself."""

    def times(self, factor: float) -> "Lamp":
        """The lamp with ``factor`` times its light."""
        return replace(self, intensity=factor * self.intensity)


@dataclass(frozen=True, kw_only=True)
class PointLamp(Lamp):
    """A lamp that shines alike in all directions, with the inverse square of the distance."""

    position: Vector
    """Position in the world, world units."""

    def light_at(self, points: Float[Tensor, "points 3"]) -> tuple[Tensor, Tensor, Tensor]:
        """See ``Lamp.light_at``."""
        offset = points.new_tensor(self.position) - points
        distance = offset.norm(dim=-1)
        intensity = self.intensity * points.new_tensor(self.colour)
        return normalize(offset, dim=-1), distance, intensity / distance.square()[:, None]


@dataclass(frozen=True, kw_only=True)
class SpotLamp(PointLamp):
    """A point lamp in a cone about its axis. Its intensity is whole within ``inner`` degrees and zero beyond ``outer``.

    Between them it is the square of (cos angle - cos outer) / (cos inner - cos outer). Raises UsageError unless
    0 <= inner < outer <= 90, and for a target at the lamp's position.
    """

    target: Vector
    """A point on the axis, in the world."""
    inner: float = 0.0
    outer: float = 45.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.inner < self.outer <= 90:
            raise UsageError(
                f"a spot lamp has the inner angle {self.inner:g} and the outer angle {self.outer:g}",
                "They are degrees from its axis, with 0 <= inner < outer <= 90.",
            )
        if self.target == self.position:
            raise UsageError("a spot lamp's target is its position", "It has no axis.")

    def light_at(self, points: Float[Tensor, "points 3"]) -> tuple[Tensor, Tensor, Tensor]:
        """See ``Lamp.light_at``."""
        direction, distance, irradiance = super().light_at(points)
        axis = normalize(points.new_tensor(self.target) - points.new_tensor(self.position), dim=0)
        inner, outer = math.cos(math.radians(self.inner)), math.cos(math.radians(self.outer))
        share = ((-direction @ axis - outer) / (inner - outer)).clamp(0, 1).square()
        return direction, distance, irradiance * share[:, None]


@dataclass(frozen=True, kw_only=True)
class Sun(Lamp):
    """Light from infinity in one direction. Raises UsageError for an elevation beyond 90 degrees."""

    azimuth: float
    """Degrees from +X towards +Y (column 1/2 - azimuth / 360 of a map, see ``scene.light``)."""
    elevation: float
    """Degrees above the horizon."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not abs(self.elevation) <= 90:
            raise UsageError(f"a sun has the elevation {self.elevation:g}", "It is -90 to 90 degrees.")

    @property
    def direction(self) -> Float[Tensor, "3"]:
        """Unit direction towards the sun, Z up, float64."""
        azimuth, elevation = math.radians(self.azimuth), math.radians(self.elevation)
        flat = math.cos(elevation)
        x, y = flat * math.cos(azimuth), flat * math.sin(azimuth)
        return torch.tensor([x, y, math.sin(elevation)], dtype=torch.float64)

    def turned(self, to_map: Float[Tensor, "3 3"]) -> "Sun":
        """The sun in a world in which maps have these axes (``placed_light.rotation_to_map``)."""
        x, y, z = (to_map.T @ self.direction).tolist()
        elevation = math.degrees(math.atan2(z, math.hypot(x, y)))
        return replace(self, azimuth=math.degrees(math.atan2(y, x)), elevation=elevation)

    def light_at(self, points: Float[Tensor, "points 3"]) -> tuple[Tensor, Tensor, Tensor]:
        """See ``Lamp.light_at``; the distance is infinite."""
        irradiance = (self.intensity * points.new_tensor(self.colour)).expand_as(points)
        return self.direction.to(points).expand_as(points), torch.full_like(points[:, 0], torch.inf), irradiance
