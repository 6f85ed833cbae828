"""How one kind of file of a public code reads: where it lies, what it holds, and how it is encoded."""

from dataclasses import dataclass
from typing import Literal

Encoding = Literal["display", "linear", "srgb", "normal", "value", "radiance"]
"""What the numbers of a file mean:

display   sRGB colour that is compared as it is (a rendered image)
linear    linear colour, as stored (albedo)
srgb      linear colour stored as sRGB (albedo)
normal    world normals n / 2 + 1 / 2; from .exr and .npy as they are
value     one number a pixel (roughness, coverage, depth)
radiance  linear radiance stored as display sRGB; from .exr and .npy as it is
"""

Ground = Literal["black", "white", "own coverage"]
"""What a file shows where nothing is covered. A fourth channel says nothing about "black" and "white" (some codes put
the true mask there); with "own coverage" colours are straight if there is a fourth channel, and on black if not."""


@dataclass(frozen=True)
class Rule:
    """Files of one map.

    ``path`` is relative to the folder, with ``{index}`` (place in the scene's list of test views, ``{index:05d}`` for
    leading zeros), ``{name}`` (a view's name, its last part, or that with ``_rgba``) and ``{light}``. A part of it may
    hold ``*`` (an iteration): the last in numerical order is read. ``part`` (k, n) takes the k-th of n images side by
    side. Of several rules for one map the first that any file is found for is used. ``other_size`` says why the code
    may have written this map at another size than the scene's: such files are left out with that reason, where
    otherwise a wrong size is an error.
    """

    map: str
    path: str
    encoding: Encoding
    ground: Ground = "black"
    part: tuple[int, int] = (0, 1)
    other_size: str = ""


@dataclass(frozen=True)
class Unread:
    """Files that look like predictions and are not read; ``pattern`` is relative to the folder, as of ``glob``."""

    pattern: str
    reason: str


@dataclass(frozen=True)
class Code:
    """A public code: its layout, what marks a folder as its own, and what one must know before reading a score.

    ``environment`` are files of the recovered light: linear radiance, latitude-longitude, Z up, centre column towards
    +X. Public codes write none: their pictures of it are clipped, and their checkpoints are not opened. ``over`` names
    codes whose marks its folders bear as well.
    """

    title: str
    rules: tuple[Rule, ...]
    relit: tuple[Rule, ...]
    marks: tuple[str, ...]
    remarks: tuple[str, ...] = ()
    unread: tuple[Unread, ...] = ()
    environment: tuple[str, ...] = ()
    over: tuple[str, ...] = ()
