"""Procedural lights on a small lat-long map (Z up, centre column towards +X), linear RGB.

The sharpest sun is half as bright at 9 degrees from its middle: three texels wide, so that a map of this size can
hold and recover it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radiogs_core.scene.light import texel_directions

HEIGHT, WIDTH = 32, 64
DIRECTIONS: NDArray[np.float64] = texel_directions(HEIGHT, WIDTH).numpy()

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
        cosine = DIRECTIONS @ axis
        return np.exp(self.sharpness * (cosine - 1))[..., None] * np.array(self.colour)


@dataclass(frozen=True)
class Sky:
    """A gradient from horizon to zenith over ground of one colour, and lobes: a sun, clouds, lamps.

    A lobe of negative colour darkens; the sum stays above zero.
    """

    zenith: Colour
    horizon: Colour
    ground: Colour
    lobes: tuple[Lobe, ...]

    def radiance(self) -> NDArray[np.float32]:
        """The light on the map, [32, 64, 3]."""
        height = DIRECTIONS[..., 2:]
        above = np.array(self.horizon) + np.sqrt(np.clip(height, 0, 1)) * np.subtract(self.zenith, self.horizon)
        gradient = np.where(height > 0, above, np.array(self.ground))
        return sum((lobe.radiance() for lobe in self.lobes), start=gradient).astype(np.float32)


LIGHTS = {
    "sky": Sky(
        zenith=(0.28, 0.4, 0.62),
        horizon=(0.55, 0.58, 0.6),
        ground=(0.16, 0.15, 0.13),
        lobes=(Lobe(azimuth=62.0, elevation=48.0, sharpness=60.0, colour=(24.0, 22.0, 18.5)),),
    ),
    "sunset": Sky(
        zenith=(0.16, 0.17, 0.3),
        horizon=(0.6, 0.38, 0.26),
        ground=(0.08, 0.07, 0.07),
        lobes=(Lobe(azimuth=12.0, elevation=26.0, sharpness=50.0, colour=(27.0, 14.5, 6.0)),),
    ),
    "morning": Sky(
        zenith=(0.24, 0.34, 0.56),
        horizon=(0.62, 0.52, 0.42),
        ground=(0.14, 0.13, 0.12),
        lobes=(Lobe(azimuth=121.0, elevation=34.0, sharpness=60.0, colour=(26.0, 20.0, 13.0)),),
    ),
    "overcast": Sky(
        zenith=(0.5, 0.6, 0.75),
        horizon=(0.4, 0.44, 0.5),
        ground=(0.14, 0.15, 0.16),
        lobes=(Lobe(azimuth=95.0, elevation=55.0, sharpness=4.0, colour=(0.7, 0.85, 1.05)),),
    ),
    "veil": Sky(
        zenith=(0.5, 0.56, 0.66),
        horizon=(0.62, 0.6, 0.58),
        ground=(0.24, 0.22, 0.2),
        lobes=(
            Lobe(azimuth=35.0, elevation=35.0, sharpness=10.0, colour=(0.55, 0.5, 0.42)),
            Lobe(azimuth=110.0, elevation=20.0, sharpness=16.0, colour=(-0.28, -0.26, -0.22)),
            Lobe(azimuth=165.0, elevation=50.0, sharpness=14.0, colour=(0.4, 0.45, 0.55)),
            Lobe(azimuth=230.0, elevation=25.0, sharpness=12.0, colour=(-0.3, -0.28, -0.25)),
            Lobe(azimuth=290.0, elevation=40.0, sharpness=16.0, colour=(0.5, 0.42, 0.38)),
            Lobe(azimuth=335.0, elevation=70.0, sharpness=20.0, colour=(-0.24, -0.26, -0.28)),
        ),
    ),
    "broken": Sky(
        zenith=(0.3, 0.42, 0.62),
        horizon=(0.52, 0.54, 0.56),
        ground=(0.15, 0.14, 0.12),
        lobes=(
            Lobe(azimuth=205.0, elevation=44.0, sharpness=60.0, colour=(20.0, 18.5, 15.5)),
            Lobe(azimuth=20.0, elevation=30.0, sharpness=25.0, colour=(1.3, 1.3, 1.3)),
            Lobe(azimuth=75.0, elevation=55.0, sharpness=20.0, colour=(1.1, 1.1, 1.15)),
            Lobe(azimuth=120.0, elevation=18.0, sharpness=30.0, colour=(-0.34, -0.34, -0.34)),
            Lobe(azimuth=150.0, elevation=65.0, sharpness=30.0, colour=(0.9, 0.9, 0.95)),
            Lobe(azimuth=275.0, elevation=25.0, sharpness=25.0, colour=(1.2, 1.15, 1.05)),
            Lobe(azimuth=325.0, elevation=15.0, sharpness=30.0, colour=(-0.34, -0.34, -0.34)),
        ),
    ),
    "lanterns": Sky(
        zenith=(0.012, 0.014, 0.026),
        horizon=(0.022, 0.02, 0.024),
        ground=(0.012, 0.011, 0.01),
        lobes=(
            Lobe(azimuth=15.0, elevation=28.0, sharpness=60.0, colour=(13.0, 7.5, 2.6)),
            Lobe(azimuth=95.0, elevation=18.0, sharpness=60.0, colour=(10.0, 1.6, 3.4)),
            Lobe(azimuth=150.0, elevation=52.0, sharpness=60.0, colour=(2.2, 8.0, 7.0)),
            Lobe(azimuth=225.0, elevation=22.0, sharpness=60.0, colour=(2.4, 3.2, 13.0)),
            Lobe(azimuth=300.0, elevation=42.0, sharpness=60.0, colour=(9.0, 8.0, 5.5)),
        ),
    ),
}
