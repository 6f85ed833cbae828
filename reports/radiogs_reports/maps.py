"""Maps of one view in display colours, and their errors as false colours."""

import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray

from .files import opened

INDIRECT_GAIN = 4.0
"""Indirect light is shown four times brighter; at its own brightness it is too dark to judge."""

ERROR_RANGE = 0.25
"""Mean absolute difference over the channels, in display units, at which false colours saturate."""

ANGLE_RANGE = 45.0
"""Angle between normals, in degrees, at which false colours saturate."""

MOST_BYTES = 1 << 32
"""Largest size of a cell's arrays, unpacked: some thirty maps of 8192 x 4096. A small archive could fill memory."""

MOST_STORED = 1 << 38
"""Largest size of a file of arrays as it is stored."""

VIEWS = "views/"
"""Prefix of the names of further views' codes."""

Image = NDArray[np.float64]
"""[height, width, channels]."""


def as_is(image: Image) -> Image:
    """The map itself, for maps that are stored in display units."""
    return image


def display(linear: Image) -> Image:
    """Linear RGB as sRGB (IEC 61966-2-1)."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)


def linear(displayed: Image) -> Image:
    """sRGB as linear RGB: the inverse of ``display``."""
    return np.where(displayed <= 0.04045, displayed / 12.92, ((np.maximum(displayed, 0.04045) + 0.055) / 1.055) ** 2.4)


def normal_colour(normal: Image) -> Image:
    """World normals, -1 to 1, as colours; black where no surface is."""
    return np.where((normal == 0).all(-1, keepdims=True), 0, normal * 0.5 + 0.5)


def difference(mine: Image, theirs: Image) -> Image:
    """Mean absolute difference over the channels of two displayed maps, over ``ERROR_RANGE``, clipped to [0, 1]."""
    return np.clip(np.abs(mine - theirs).mean(-1, keepdims=True) / ERROR_RANGE, 0, 1)


def angle(mine: Image, theirs: Image) -> Image:
    """Angle between the normals of two maps, over ``ANGLE_RANGE``, clipped to [0, 1].

    0 where neither map has a surface, 1 where only one has. By atan2: acos is NaN for a cosine one rounding above 1.
    """
    cross = np.linalg.norm(np.cross(mine, theirs), axis=-1, keepdims=True)
    degrees = np.degrees(np.arctan2(cross, (mine * theirs).sum(-1, keepdims=True)))
    bare_mine, bare_theirs = ((image == 0).all(-1, keepdims=True) for image in (mine, theirs))
    degrees = np.where(bare_mine ^ bare_theirs, ANGLE_RANGE, np.where(bare_mine & bare_theirs, 0, degrees))
    return np.clip(degrees / ANGLE_RANGE, 0, 1)


@dataclass(frozen=True)
class Kind:
    """A kind of map."""

    label: str
    shown: Callable[[Image], Image]
    """Its display transform."""
    error_to: str = "mean absolute difference as displayed, 0 to {}"
    """Unit of its error map, with the place of the range's end."""
    error_range: float = ERROR_RANGE

    @property
    def error_unit(self) -> str:
        """Unit and range of its error map."""
        return self.error_to.format(f"{self.error_range:g}")


KINDS: Mapping[str, Kind] = {
    "image": Kind("image", as_is),
    "albedo": Kind("albedo (as sRGB)", display),
    "normal": Kind("normal", normal_colour, "angle, 0 to {} degrees", ANGLE_RANGE),
    "roughness": Kind("roughness", as_is),
    "depth": Kind("depth, near is bright", as_is),
    "indirect": Kind(f"indirect light x {INDIRECT_GAIN:g}", lambda image: display(INDIRECT_GAIN * image)),
    "incident": Kind(f"incident indirect light x {INDIRECT_GAIN:g}", lambda image: display(INDIRECT_GAIN * image)),
    "incident_direct": Kind("incident direct light", display),
    "relit": Kind("relit", as_is),
    "relit_indirect": Kind(f"relit, indirect light x {INDIRECT_GAIN:g}", lambda image: display(INDIRECT_GAIN * image)),
}
"""Kinds of maps by name, in the order in which they are shown."""


def kind_of(name: str) -> Kind:
    """The kind of a map by its name; relit maps are named after their light too."""
    kind, _, light = name.partition("/")
    return replace(KINDS[kind], label=f"{KINDS[kind].label} under {light}") if light else KINDS[kind]


def error(kind: str, mine: Image, theirs: Image) -> Image:
    """Error of a map against the truth in [0, 1], [height, width, 1]; 1 means the end of the kind's ``error_unit``."""
    if kind == "normal":
        return angle(mine, theirs)
    return difference(*(np.clip(kind_of(kind).shown(image), 0, 1) for image in (mine, theirs)))


def read_maps(path: Path, start: str = "") -> dict[str, Image]:
    """A cell's arrays by name, ``render/<map>``, ``truth/<map>`` and ``surfels/<part>``, in float64.

    ``start``: only arrays whose names begin with it. Codes of further views (``views/...``) are left out.

    Raises ValueError for a file that unpacks to more than ``MOST_BYTES``.
    """
    with open_codes(path) as archive:
        wanted = [name for name in archive.files if name.startswith(start) and not name.startswith(VIEWS)]
        return {name: archive[name].astype(np.float64) for name in wanted}


def open_codes(path: Path) -> "np.lib.npyio.NpzFile":
    """A cell's archive, to read codes of further views from: ``views/<number>/<side>/<map>``, uint8. To be closed.

    Raises ValueError for an array, or all arrays without codes, of more than ``MOST_BYTES`` when unpacked.
    """
    with opened(path, MOST_STORED) as file, zipfile.ZipFile(file) as parts:
        sizes = [part.file_size * (not part.filename.startswith(VIEWS)) for part in parts.infolist()]
        if sum(sizes) > MOST_BYTES or any(part.file_size > MOST_BYTES for part in parts.infolist()):
            raise ValueError(f"{path} unpacks to more than {MOST_BYTES} bytes: no cell stores that much")
    return np.load(path)


def decoded(name: str, codes: NDArray[np.uint8]) -> Image:
    """Codes of 8 bits of a map as it is stored otherwise: albedo and indirect light linear, normals -1 to 1."""
    values = codes / 255.0
    if name in ("albedo", "indirect"):
        return linear(values)
    if name == "normal":
        return np.where((codes == 0).all(-1, keepdims=True), 0, values * 2 - 1)
    return values


def false_colour(values: Image) -> Image:
    """Values in [0, 1], [height, width, 1], as colours of matplotlib's inferno."""
    return colormaps["inferno"](np.clip(values[..., 0], 0, 1))[..., :3]


def levels(image: Image) -> NDArray[np.uint8]:
    """A displayed map as 8-bit RGB, [height, width, 3]."""
    rounded = np.rint(np.clip(image, 0, 1) * 255).astype(np.uint8)
    return rounded.repeat(3, -1) if rounded.shape[2] == 1 else rounded[..., :3]
