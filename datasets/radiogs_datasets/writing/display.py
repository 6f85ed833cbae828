"""Rendered radiance as an image file."""

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from radiogs_core.scene.colour import srgb_encode

from ..image_files import write_png


def write_display(
    path: Path, radiance: NDArray[np.float32], coverage: NDArray[np.float32], alpha: NDArray[np.float32]
) -> None:
    """PNG of straight sRGB and ``alpha``, from linear RGB that is multiplied by the picture's own ``coverage``."""
    straight = radiance[..., :3] / np.where(coverage > 0, coverage, 1)
    display = srgb_encode(torch.from_numpy(np.where(alpha > 0, straight, 0).astype(np.float32))).numpy()
    write_png(path, np.concatenate([display, alpha], -1))
