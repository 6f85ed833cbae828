"""Photos of known points through every lens, by COLMAP's own formulas."""

import numpy as np

from radiogs_datasets.cameras.lens import PARAMETERS

WIDTH, HEIGHT, FOCAL = 320, 240, 230.0


TOLERANCE = 0.09
"""Pixels: OpenCV samples at multiples of 1/32, and the dots are bent by a little."""


MIDDLE = (161.3, 118.2)


LENSES: dict[str, tuple[float, ...]] = {
    "SIMPLE_PINHOLE": (FOCAL, *MIDDLE),
    "PINHOLE": (FOCAL, 1.05 * FOCAL, *MIDDLE),
    "SIMPLE_RADIAL": (FOCAL, *MIDDLE, -0.22),
    "RADIAL": (FOCAL, *MIDDLE, 0.2, -0.12),
    "OPENCV": (FOCAL, 1.05 * FOCAL, *MIDDLE, -0.25, 0.08, 0.012, -0.009),
    "OPENCV_FISHEYE": (0.7 * FOCAL, 0.72 * FOCAL, *MIDDLE, 0.05, -0.02, 0.004, -0.001),
    "FULL_OPENCV": (FOCAL, 1.05 * FOCAL, *MIDDLE, 0.1, 0.05, 0.004, -0.006, 0.02, 0.3, 0.02, 0.01),
    "SIMPLE_FISHEYE": (0.7 * FOCAL, *MIDDLE),
    "FISHEYE": (0.7 * FOCAL, 0.72 * FOCAL, *MIDDLE),
    "SIMPLE_RADIAL_FISHEYE": (0.7 * FOCAL, *MIDDLE, -0.06),
    "RADIAL_FISHEYE": (0.7 * FOCAL, *MIDDLE, -0.05, 0.02),
}


def bent(model: str, parameters: tuple[float, ...], points: np.ndarray) -> np.ndarray:
    """Pixels [points, 2] of points [points, 3] in the camera, pixel centres at +0.5, by COLMAP's formulas."""
    u, v = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    named = dict(zip(PARAMETERS[model], parameters, strict=True))
    k1, k2, k3, k4, k5, k6, p1, p2 = (named.get(name, 0.0) for name in ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"))
    r = np.hypot(u, v)
    if model.endswith("FISHEYE"):
        t = np.arctan(r)
        factor = np.where(r > 1e-9, t / np.maximum(r, 1e-9), 1.0)
        factor = factor * (1 + k1 * t**2 + k2 * t**4 + k3 * t**6 + k4 * t**8)
        u, v = u * factor, v * factor
    else:
        radial = (1 + k1 * r**2 + k2 * r**4 + k3 * r**6) / (1 + k4 * r**2 + k5 * r**4 + k6 * r**6)
        u, v = (
            u * radial + 2 * p1 * u * v + p2 * (r**2 + 2 * u**2),
            v * radial + 2 * p2 * u * v + p1 * (r**2 + 2 * v**2),
        )
    fx, fy = (named["f"], named["f"]) if "f" in named else (named["fx"], named["fy"])
    return np.stack([fx * u + named["cx"], fy * v + named["cy"]], -1)


def dots(places: np.ndarray, height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    """A dark picture, sRGB levels, with a round bright dot at each place (x, y)."""
    row, column = np.mgrid[:height, :width] + 0.5
    picture = np.zeros((height, width))
    for x, y in places:
        picture += np.exp(-((column - x) ** 2 + (row - y) ** 2) / (2 * 1.5**2))
    return np.rint(255 * np.clip(picture, 0, 1)).astype(np.uint8)[..., None].repeat(3, 2)


def dot_near(picture: np.ndarray, x: float, y: float) -> tuple[float, float]:
    """The centroid of what is bright within seven pixels of a place."""
    row, column = np.mgrid[: picture.shape[0], : picture.shape[1]] + 0.5
    weight = np.where((column - x) ** 2 + (row - y) ** 2 < 7**2, picture, 0)
    return float((weight * column).sum() / weight.sum()), float((weight * row).sum() / weight.sum())
