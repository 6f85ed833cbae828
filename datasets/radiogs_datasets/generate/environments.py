"""Procedural lights on a small lat-long map (Z up, centre column towards +X), linear RGB.

The sharpest sun is half as bright at 9 degrees from its middle: three texels wide, so that a map of this size can
hold and recover it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radiogs_core.scene.light import texel_directions

HEIGHT, WIDTH = 32, 64

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Lobe:
    """``colour * exp(sharpness (cos angle - 1))`` about a direction in degrees, azimuth from +X to +Y."""

    azimuth: float
    elevation: float
    sharpness: float
    colour: Colour

    def radiance(self) -> NDArray[np.float64]:
        """The lobe on the map."""
        phi, theta = np.radians([self.azimuth, self.elevation])
        axis = np.array([np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), np.sin(theta)])
        cosine = _directions() @ axis
        return np.exp(self.sharpness * (cosine - 1))[..., None] * np.array(self.colour)


@dataclass(frozen=True)
class Sky:
    """A gradient from horizon to zenith over ground of one colour, and a sun."""

    zenith: Colour
    horizon: Colour
    ground: Colour
    sun: Lobe

    def radiance(self) -> NDArray[np.float32]:
        """The light on the map, [32, 64, 3]."""
        height = _directions()[..., 2:]
        above = np.array(self.horizon) + np.sqrt(np.clip(height, 0, 1)) * np.subtract(self.zenith, self.horizon)
        return (np.where(height > 0, above, np.array(self.ground)) + self.sun.radiance()).astype(np.float32)


LIGHTS = {
    "sky": Sky(
        zenith=(0.28, 0.4, 0.62),
        horizon=(0.55, 0.58, 0.6),
        ground=(0.16, 0.15, 0.13),
        sun=Lobe(azimuth=62.0, elevation=48.0, sharpness=60.0, colour=(24.0, 22.0, 18.5)),
    ),
    "sunset": Sky(
        zenith=(0.16, 0.17, 0.3),
        horizon=(0.6, 0.38, 0.26),
        ground=(0.08, 0.07, 0.07),
        sun=Lobe(azimuth=12.0, elevation=26.0, sharpness=50.0, colour=(27.0, 14.5, 6.0)),
    ),
    "morning": Sky(
        zenith=(0.24, 0.34, 0.56),
        horizon=(0.62, 0.52, 0.42),
        ground=(0.14, 0.13, 0.12),
        sun=Lobe(azimuth=121.0, elevation=34.0, sharpness=60.0, colour=(26.0, 20.0, 13.0)),
    ),
    "overcast": Sky(
        zenith=(0.5, 0.6, 0.75),
        horizon=(0.4, 0.44, 0.5),
        ground=(0.14, 0.15, 0.16),
        sun=Lobe(azimuth=95.0, elevation=55.0, sharpness=4.0, colour=(0.7, 0.85, 1.05)),
    ),
}


def _directions() -> NDArray[np.float64]:
    return texel_directions(HEIGHT, WIDTH).numpy()
