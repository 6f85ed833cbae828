"""Options for opening a scene: its layout, the scored views, masks, and the size of its images."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from radiogs_core.errors import UsageError

TEST_EVERY = 8
"""Every eighth view of a scene without splits is a test view, as for MipNeRF360."""

Meaning = Literal["object", "ignore"]
"""Meanings of black in masks: no object is there, or the pixel is left out of training and metrics."""


@dataclass(frozen=True)
class SceneOptions:
    """How a scene is opened; the defaults take it as it is stored.

    ``hold_out``, ``mask_folder``, ``masks`` and ``undistorted`` are for layouts ``colmap``, ``blender`` and ``llff``
    without a test split. Raises UsageError for numbers out of range, and for both ``reduce`` and ``long_side``.
    """

    layout: str | None = None
    """Read the scene in this layout (default: recognised from its files)."""
    hold_out: int | None = None
    """Keep every Nth view of photos, in the order of names, for testing (default: every 8th)."""
    mask_folder: str | None = None
    """Read a mask for every photo, by the photo's name, from this folder."""
    reduce: int | None = None
    """Divide both sides of every image by this number."""
    long_side: int | None = None
    """Downscale images to at most this many pixels on their longer side."""
    masks: Meaning | None = None
    """Take black in masks for places where nothing is (object, the default), or leave such pixels out of training and
    metrics (ignore)."""
    undistorted: bool | None = None
    """Take photos as pinhole images: they are undistorted already, and their cameras still have the distortion."""

    def __post_init__(self) -> None:
        if self.mask_folder is not None:  # valid in another working folder
            object.__setattr__(self, "mask_folder", str(Path(self.mask_folder).resolve()))
        if self.masks not in (None, *get_args(Meaning)):
            raise UsageError(
                f"masks cannot mean '{self.masks}'",
                "Black in a mask means that nothing is there (object), or that the pixel is left out (ignore).",
                "Give --masks object or --masks ignore.",
            )
        if self.hold_out is not None and self.hold_out < 2:
            raise UsageError(f"every {self.hold_out}th view cannot be held out", "None would be left to learn from.")
        if self.reduce is not None and self.long_side is not None:
            raise UsageError("--reduce and --long-side both set the size of images", "", "Give one of them.")
        for name, value in (("reduce", self.reduce), ("long-side", self.long_side)):
            if value is not None and value < 1:
                raise UsageError(f"--{name} {value} leaves no pixels", "", "Give a whole number above zero.")

    def plain(self) -> dict[str, Any]:
        """The options that are set; empty for a scene without changes."""
        return {name: value for name, value in asdict(self).items() if value is not None}


AS_STORED = SceneOptions()


def options_of(plain: Mapping[str, Any]) -> SceneOptions:
    """The options that ``plain()`` wrote. Raises UsageError for invalid names and values."""
    texts, numbers = ("layout", "mask_folder", "masks"), ("hold_out", "reduce", "long_side")
    kinds = dict.fromkeys(texts, str) | dict.fromkeys(numbers, int) | {"undistorted": bool}
    for name, value in plain.items():
        if name not in kinds or type(value) is not kinds[name]:
            raise UsageError(f"a scene cannot be opened with {name} = {value!r}", f"It takes: {', '.join(kinds)}.")
    return SceneOptions(**plain)
