"""Difference of colours as people see it, which a mean squared error of linear values is not."""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from .pictures import SOLID, Image, Mask

TO_XYZ = ((0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505))
"""CIE XYZ of linear sRGB (IEC 61966-2-1)."""


def ciede2000(ours: Image, theirs: Image, mask: Mask) -> float:
    """Mean CIEDE2000 of two linear sRGB images where the mask covers more than half; NaN where it does nowhere.

    A surface of albedo 1 is white under D65 (L* = 100). 1 is about what an eye can tell apart; black against white is
    100. By colour-science (CIE 142-2001, Sharma et al. 2005).
    """
    from colour.difference import delta_E_CIE2000  # slow to import, and only protocols that ask for it need it

    inside = mask[..., 0] > SOLID
    if not inside.any():
        return float("nan")
    return float(np.mean(delta_E_CIE2000(lab(theirs[inside]), lab(ours[inside]))))


def lab(linear: Float[Tensor, "pixels 3"]) -> Float[np.ndarray, "pixels 3"]:
    """CIE L*a*b* relative to D65 of linear sRGB, clipped to [0, 1]."""
    from colour.models import XYZ_to_Lab

    to_xyz = torch.tensor(TO_XYZ, dtype=torch.float64)
    xyz = linear.clamp(0, 1).double() @ to_xyz.T
    white = to_xyz.sum(1)
    return np.asarray(XYZ_to_Lab(xyz.numpy(), (white[:2] / white.sum()).numpy()))
