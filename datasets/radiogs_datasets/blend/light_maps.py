"""A light as Blender reads it: the same function of the direction as the project's bilinear lookup."""

import numpy as np
from numpy.typing import NDArray

ROWS = 480
"""Rows that a map is refined to: Blender continues a map beyond its poles with the rows of the other pole, and that
reaches half a row."""


def refined(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """The map at an odd multiple of its size, at least ROWS rows: bilinear lookup of it is that of the map itself.

    By an odd factor every texel's middle stays one, so that the refined map bends where the map does. Columns wrap;
    rows end at the poles.
    """
    factor = max(1, -(-ROWS // light.shape[0]))
    factor += 1 - factor % 2
    return _along(_along(light, 0, factor, wrap=False), 1, factor, wrap=True)


def _along(light: NDArray[np.float32], axis: int, factor: int, wrap: bool) -> NDArray[np.float32]:
    count = light.shape[axis]
    place = (np.arange(count * factor) + 0.5) / factor - 0.5
    if not wrap:
        place = np.clip(place, 0, count - 1)
    below = np.floor(place).astype(int)
    shape = [1] * light.ndim
    shape[axis] = -1
    share = (place - below).reshape(shape)
    first, second = below % count, ((below + 1) % count if wrap else np.minimum(below + 1, count - 1))
    values = light.astype(np.float64)
    return ((1 - share) * values.take(first, axis) + share * values.take(second, axis)).astype(np.float32)
