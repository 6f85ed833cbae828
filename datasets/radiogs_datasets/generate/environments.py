"""Procedural lights: gradients and lobes on a small lat-long map (Z up, centre column towards +X), linear RGB.

The sun is a lobe of about 11 degrees, two texels wide, so that a map of this size can hold and recover it.
"""

import numpy as np
from numpy.typing import NDArray
from radiogs.light import texel_directions

HEIGHT, WIDTH = 32, 64


def _lobe(azimuth: float, elevation: float, sharpness: float, colour: tuple[float, float, float]) -> NDArray:
    """colour * exp(sharpness (cos angle - 1)) about a direction given in degrees."""
    phi, theta = np.radians([azimuth, elevation])
    axis = np.array([np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), np.sin(theta)])
    cosine = texel_directions(HEIGHT, WIDTH).numpy() @ axis
    return np.exp(sharpness * (cosine - 1))[..., None] * np.array(colour)


def _gradient(
    zenith: tuple[float, float, float], horizon: tuple[float, float, float], ground: tuple[float, float, float]
) -> NDArray:
    height = texel_directions(HEIGHT, WIDTH).numpy()[..., 2:]
    sky = np.array(horizon) + np.sqrt(np.clip(height, 0, 1)) * (np.array(zenith) - np.array(horizon))
    return np.where(height > 0, sky, np.array(ground))


def environment(name: str) -> NDArray[np.float32]:
    """The light of that name, [32, 64, 3]."""
    lights = {
        "sky": lambda: _gradient((0.28, 0.4, 0.62), (0.55, 0.58, 0.6), (0.16, 0.15, 0.13))
        + _lobe(62, 48, 60, (24.0, 22.0, 18.5)),
        "sunset": lambda: _gradient((0.16, 0.17, 0.3), (0.6, 0.38, 0.26), (0.08, 0.07, 0.07))
        + _lobe(12, 26, 50, (27.0, 14.5, 6.0)),
        "overcast": lambda: _gradient((0.5, 0.6, 0.75), (0.4, 0.44, 0.5), (0.14, 0.15, 0.16))
        + _lobe(95, 55, 4, (0.7, 0.85, 1.05)),
    }
    return lights[name]().astype(np.float32)
