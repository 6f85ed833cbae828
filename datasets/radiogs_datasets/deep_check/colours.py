"""Transfer functions on arrays, and the likely wrong readings of colours."""

from collections.abc import Callable

import numpy as np
import torch

from radiogs_core.scene.colour import srgb_decode, srgb_encode

from .cameras import Array

Reading = tuple[str, Callable[[Array], Array]]
"""Words for how values are stored, and what they are then by the scene's convention."""


def decoded(display: Array) -> Array:
    """Display sRGB to linear."""
    return np.asarray(srgb_decode(torch.from_numpy(np.ascontiguousarray(display))))


def encoded(linear: Array) -> Array:
    """Linear, at least zero, to display sRGB."""
    return np.asarray(srgb_encode(torch.from_numpy(np.ascontiguousarray(linear.clip(0)))))


EXCHANGED: Reading = ("red and blue exchanged", lambda values: values[..., ::-1])

DISPLAY: tuple[Reading, ...] = (
    ("the sRGB curve applied twice", decoded),
    ("linear values where display sRGB is expected", encoded),
    EXCHANGED,
)
"""For images."""

LINEAR: tuple[Reading, ...] = (
    ("display sRGB where linear values are expected", decoded),
    ("linear values decoded as if they were display sRGB", encoded),
    EXCHANGED,
)
"""For albedo."""
