"""Pictures that several metrics are tested on."""

from pathlib import Path

import cv2
import numpy as np
import torch


def example(shared_data: Path, name: str) -> torch.Tensor:
    """One of LPIPS' own 64-pixel example images, display RGB in [0, 1]."""
    image = cv2.imread(str(shared_data / "lpips" / "imgs" / f"{name}.png"))
    return torch.from_numpy(np.ascontiguousarray(image[..., ::-1])).float() / 255
