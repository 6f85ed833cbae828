"""The layout of a public code's files: rules for their paths, maps and encodings."""

from dataclasses import dataclass
from typing import Literal

Encoding = Literal["display", "linear", "srgb", "normal", "value", "radiance"]
"""Encoding of a file's values:

display   sRGB colour that is compared without conversion (a rendered image)
linear    linear colour, as stored (albedo)
srgb      linear colour stored as sRGB (albedo)
normal    world normals stored as n / 2 + 1 / 2; in .exr and .npy files as n
value     one number for each pixel (roughness, coverage, depth)
radiance  linear radiance stored as display sRGB; in .exr and .npy files as linear radiance
"""

Ground = Literal["black", "white", "own coverage", "own coverage or white"]
"""Background of a file. For "black" and "white" a fourth channel is ignored (some codes store the true mask there); for
"own coverage" colours are straight if there is a fourth channel, and on black otherwise, or on white."""


@dataclass(frozen=True)
class Rule:
    """The files of one map. If a map has several rules, the first one with any file is used; but files by ``{number}``
    are used where they are complete and files by ``{name}`` are not: names of views may be numbers, too."""

    map: str
    """Name of the map."""
    path: str
    """Path relative to the folder, with ``{index}`` (index among the scene's test views; ``{index:05d}`` with leading
    zeros), ``{number}`` (the same index with any number of leading zeros), ``{name}`` (the view's name, its last part,
    or that with ``_rgba``) and ``{light}``. A part may contain ``*``, such as an iteration: the last entry in numerical
    order is read."""
    encoding: Encoding
    """Encoding of the values."""
    ground: Ground = "black"
    """Background."""
    part: tuple[int, int] = (0, 1)
    """(k, n): the map is image k of n images side by side in the file."""
    other_size: str = ""
    """Reason why the code may have written this map at another size than the scene's. Such files are ignored, with this
    reason; without a reason, a wrong size is an error."""

    @property
    def numbered(self) -> bool:
        """Whether its files are numbered with any number of leading zeros."""
        return "{number}" in self.path


@dataclass(frozen=True)
class Unread:
    """Files that look like predictions but are not read."""

    pattern: str
    """Glob pattern, relative to the folder."""
    reason: str
    """Reason why they are not read."""


@dataclass(frozen=True)
class Code:
    """The layout of a public code's results."""

    title: str
    """Name of the public code, as messages print it."""
    rules: tuple[Rule, ...]
    """Rules of the maps of test views."""
    relit: tuple[Rule, ...]
    """Rules of relit images."""
    marks: tuple[str, ...]
    """Glob patterns of files by which a folder of this code is recognised."""
    remarks: tuple[str, ...] = ()
    """Sentences on the layout that matter for its scores."""
    unread: tuple[Unread, ...] = ()
    """Files that look like predictions but are not read."""
    environment: tuple[str, ...] = ()
    """Glob patterns of the recovered light: linear radiance, lat-long, Z up, centre column towards +X."""
    over: tuple[str, ...] = ()
    """Names of the codes whose ``marks`` also occur in folders of this code; such a folder is not taken for theirs."""

    def rules_of(self, kind: str) -> tuple[Rule, ...]:
        """The rules of one map, in the order in which they are tried."""
        return tuple(rule for rule in self.rules if rule.map == kind)
