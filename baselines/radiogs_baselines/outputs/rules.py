"""How one kind of file of a public code reads: where it lies, what it holds, and how it is encoded."""

from dataclasses import dataclass
from typing import Literal

Encoding = Literal["display", "linear", "srgb", "gamma 2.2", "normal", "value", "radiance"]
"""What the numbers of a file mean:

display    sRGB colour that is compared as it is (a rendered image)
linear     linear colour, as stored (albedo)
srgb       linear colour stored as sRGB (albedo)
gamma 2.2  linear colour stored to the power of 1 / 2.2 (albedo)
normal     world normals n / 2 + 1 / 2; from .exr and .npy as they are
value      one number a pixel (roughness, coverage, depth)
radiance   linear radiance stored as display sRGB; from .exr and .npy as it is
"""

Ground = Literal["black", "white", "straight"]
"""What a file shows where nothing is covered; "straight" colours are not multiplied by coverage at all."""


@dataclass(frozen=True)
class Rule:
    """Files of one map.

    ``path`` is relative to the folder, with ``{index}`` (place in the scene's list of test views, ``{index:05d}`` for
    leading zeros), ``{name}`` (a view's name, or the last part of it) and ``{light}``. A part of it may hold ``*`` (an
    iteration): the last in numerical order is read. ``part`` (k, n) takes the k-th of n images side by side.
    """

    map: str
    path: str
    encoding: Encoding
    ground: Ground = "black"
    part: tuple[int, int] = (0, 1)


@dataclass(frozen=True)
class Code:
    """A public code: its layout, what marks a folder as its own, and what one must know before reading a score.

    ``over`` names codes whose marks its folders bear as well.
    """

    title: str
    rules: tuple[Rule, ...]
    relit: tuple[Rule, ...]
    marks: tuple[str, ...]
    remarks: tuple[str, ...] = ()
    over: tuple[str, ...] = ()
