"""Lights from files: environment maps, which are distant light as linear radiance, and lamps.

A latitude-longitude map is twice as wide as high. Cube maps are converted if the layout of their faces is known:
OpenEXR's attribute ``envmap`` (faces +X, -X, +Y, -Y, +Z, -Z of a world with Y up, in a column), and crosses with empty
corners, which fold in one way. Any other shape is refused by name, because the directions of its pixels are unknown.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.errors import DataError, UsageError
from radiogs_core.plain_values import PlainReader
from radiogs_core.scene.lamps import Lamp, PointLamp, SpotLamp, Sun
from radiogs_core.scene.light import EnvironmentMap, texel_directions

from .bounded_reading import printable, read_json, read_toml
from .image_files import read_exr, read_hdr
from .image_structure import exr_envmap

OWN_LIGHTS = Path(__file__).parent / "tiny" / "corner" / "envmaps"
"""A folder of maps that comes with the package: a sunny sky (``training``), a sunset, an overcast sky."""


def read_light(path: Path) -> tuple[EnvironmentMap, list[str]]:
    """A map of distant light, Z up, from RGB or RGBA, and sentences on what was changed.

    Negative radiance becomes zero; cube maps with a known layout of faces become latitude-longitude maps. Raises
    UsageError for a file of another kind than .hdr and .exr, DataError for a damaged one, for one of fewer channels,
    for a black one, and for one of another shape.
    """
    readers = {".hdr": read_hdr, ".exr": read_exr}
    if path.suffix.lower() not in readers:
        raise UsageError(f"{path} is neither .hdr nor .exr", "Light needs linear values above one.")
    image = readers[path.suffix.lower()](path)[..., :3]
    if image.shape[2] < 3:
        raise DataError(
            f"{path} has {image.shape[2]} channels, 3 are needed", "Light has a colour.", "Export it as RGB."
        )
    if not float(image.max()) > 0:
        raise DataError(f"{path} is dark: none of its radiance is above zero", "It lights nothing.", "Export it again.")
    negative = int((image < 0).sum())
    said = [f"{path.name}: {negative} negative values of radiance were set to zero"] if negative else []
    stored = torch.from_numpy(np.ascontiguousarray(image)).clamp(min=0)
    envmap = exr_envmap(path) if path.suffix.lower() == ".exr" else None
    radiance, how = latitude_longitude(path, stored, envmap)
    return EnvironmentMap(radiance), [*said, *([f"{path.name}: {how}"] if how else [])]


@dataclass(frozen=True)
class LampFile:
    """The schema of a file of lamps: a table for each lamp, with the fields of its class."""

    point: tuple[PointLamp, ...] = ()
    spot: tuple[SpotLamp, ...] = ()
    sun: tuple[Sun, ...] = ()


def read_lamps(path: Path | str) -> tuple[Lamp, ...]:
    """The lamps of a .toml or .json file: its point lamps, its spot lamps, then its suns.

    Raises UsageError for a file of another kind, DataError for one that is damaged, has no lamp, or has a field that is
    unknown, missing or invalid.
    """
    path = Path(path)
    if path.suffix.lower() not in (".toml", ".json"):
        raise UsageError(f"{path} is neither .toml nor .json", "Lamps are tables of numbers.", "A map is an --envmap.")
    try:
        content = read_json(path) if path.suffix.lower() == ".json" else read_toml(path)
        found: LampFile = PlainReader(printable(path), LAMPS_MANUAL).build(LampFile, content, "")
    except UsageError as refused:
        raise DataError(refused.what, refused.why, refused.remedy) from refused
    except ValueError as error:
        raise DataError(f"{printable(path)} is not valid TOML: {error!s:.200}", "", LAMPS_MANUAL) from error
    lamps = (*found.point, *found.spot, *found.sun)
    if not lamps:
        raise DataError(f"{printable(path)} has no lamp", "It lights nothing.", LAMPS_MANUAL)
    return lamps


LAMPS_MANUAL = "The tables of lamps are described in docs/datasets.md; docs/examples/lamps.toml has one of each."

Face = tuple[tuple[int, int], tuple[int, int, int], tuple[int, int, int], tuple[int, int, int]]
"""A face of a cube map: its row and column among the faces of the file, the direction that it faces, and those of its
columns and rows. Directions are in the world that the map is read in: Z up, +X in the centre column."""

AHEAD: Face = (1, 1), (1, 0, 0), (0, -1, 0), (0, 0, -1)
LEFT: Face = (1, 0), (0, 1, 0), (1, 0, 0), (0, 0, -1)
RIGHT: Face = (1, 2), (0, -1, 0), (-1, 0, 0), (0, 0, -1)
ABOVE: Face = (0, 1), (0, 0, 1), (0, -1, 0), (1, 0, 0)
BELOW: Face = (2, 1), (0, 0, -1), (0, -1, 0), (-1, 0, 0)

CROSSES: dict[tuple[int, int], tuple[str, tuple[Face, ...]]] = {
    (4, 3): ("vertical", (AHEAD, LEFT, RIGHT, ABOVE, BELOW, ((3, 1), (-1, 0, 0), (0, -1, 0), (0, 0, 1)))),
    (3, 4): ("horizontal", (AHEAD, LEFT, RIGHT, ABOVE, BELOW, ((1, 3), (-1, 0, 0), (0, 1, 0), (0, 0, -1)))),
}
"""Unfolded cubes seen from within, by rows and columns of faces. The face that four others touch is ahead."""

OPENEXR_FACES: tuple[Face, ...] = (
    ((0, 0), (0, 1, 0), (1, 0, 0), (0, 0, -1)),
    ((1, 0), (0, -1, 0), (-1, 0, 0), (0, 0, -1)),
    ((2, 0), (0, 0, 1), (0, 1, 0), (-1, 0, 0)),
    ((3, 0), (0, 0, -1), (0, 1, 0), (1, 0, 0)),
    ((4, 0), (1, 0, 0), (0, -1, 0), (0, 0, -1)),
    ((5, 0), (-1, 0, 0), (0, 1, 0), (0, 0, -1)),
)
"""ImfEnvmap.cpp: +X, -X, +Y, -Y, +Z, -Z of a world with Y up, whose X is Y here, and whose Z is X here."""


def latitude_longitude(
    path: Path | str, stored: Float[Tensor, "height width 3"], envmap: str | None = None
) -> tuple[Float[Tensor, "rows columns 3"], str]:
    """A stored light as latitude-longitude map (``radiogs_core.scene.light``), and a sentence if it was converted.

    ``envmap``: OpenEXR's attribute of that name, ``latlong`` or ``cube``; None without it. Raises DataError for another
    shape. A constant light is accepted in any shape.
    """
    height, width = stored.shape[:2]
    if envmap == "cube" and height == 6 * width:
        radiance = unfolded(stored, OPENEXR_FACES, width, at_edges=True)
        return radiance, "converted from a cube map (OpenEXR's attribute envmap): its Y is up, its +Z the centre column"
    fits = abs(width - 2 * height) <= 1 and envmap != "cube"
    if fits or bool((stored == stored[:1, :1]).all()):
        return stored, ""
    for (rows, columns), (name, faces) in CROSSES.items():
        shaped = envmap is None and height * columns == width * rows and not height % rows
        if shaped and _empty_corners(stored, faces, height // rows):
            said = f"converted from a {name} cross, whose middle face is taken for the centre column"
            return unfolded(stored, faces, height // rows, at_edges=False), said
    raise _not_twice_as_wide(path, height, width, envmap)


def _not_twice_as_wide(path: Path | str, height: int, width: int, envmap: str | None) -> DataError:
    shapes = {
        height == width: "A square is an angular map, a mirrored ball or an octahedral map, and does not say which.",
        width == 6 * height or height == 6 * width: "It looks like the six faces of a cube in a strip, but not in which"
        " order, nor how each is turned.",
        width == 4 * height: "It looks like the upper half of the sphere alone: the light from below is missing.",
        height * 3 == width * 4 or width * 3 == height * 4: "It has the shape of a cross of a cube's faces, but its"
        " corners are not empty.",
        envmap == "cube": "OpenEXR's cube maps are six times as high as wide.",
    }
    return DataError(
        f"{path} is {width} x {height} pixels: no latitude-longitude map, which is twice as wide as high",
        shapes.get(True, "Nothing in it says which direction a pixel shows."),
        "Convert it to latitude-longitude (HDRShop and cmft do), or give a cross of the cube's faces with black"
        " corners; add what a part of the sphere lacks.",
    )


def _empty_corners(stored: Float[Tensor, "height width 3"], faces: tuple[Face, ...], side: int) -> bool:
    """Whether all texels outside the faces have one value."""
    beside = torch.ones(stored.shape[:2], dtype=torch.bool)
    for (row, column), *_ in faces:
        beside[row * side : (row + 1) * side, column * side : (column + 1) * side] = False
    return bool((stored[beside] == stored[0, 0]).all())


ROWS_AT_A_TIME = 64
"""Rows of a map that are converted at a time, which bounds the memory."""


def unfolded(
    stored: Float[Tensor, "height width 3"], faces: tuple[Face, ...], side: int, at_edges: bool
) -> Float[Tensor, "rows columns 3"]:
    """A cube map of faces of ``side`` pixels as latitude-longitude map of 2 x ``side`` rows.

    Each texel is the mean of 2 x 2 directions, bilinear in a face. ``at_edges``: whether the first and last pixels of a
    face lie on its edges, as OpenEXR's do, instead of half a pixel within.
    """
    blocks = [stored[r * side : (r + 1) * side, c * side : (c + 1) * side] for (r, c), *_ in faces]
    cube = torch.stack(blocks).flatten(0, 2)
    axes = torch.tensor([axes for _, *axes in faces], dtype=torch.float32)
    directions = texel_directions(4 * side, 8 * side, dtype=torch.float32)
    span, begin = (side - 1, 0.0) if at_edges else (side, -0.5)
    rows = []
    for part in directions.split(2 * ROWS_AT_A_TIME):
        along = torch.einsum("fad,hwd->hwfa", axes, part)
        face = along[..., 0].argmax(-1)
        depth, right, down = along.gather(2, face[..., None, None].expand(*face.shape, 1, 3))[..., 0, :].unbind(-1)
        places = [((each / depth + 1) / 2 * span + begin).clamp(0, side - 1) for each in (down, right)]
        fine = _bilinear(cube, face * side * side, places, side)
        rows.append(fine.unflatten(0, (-1, 2)).unflatten(2, (-1, 2)).mean((1, 3)))
    return torch.cat(rows)


def _bilinear(
    cube: Float[Tensor, "pixels 3"], begin: Tensor, places: list[Float[Tensor, "height width"]], side: int
) -> Float[Tensor, "height width 3"]:
    """Values of faces between four pixels; ``places``: row and column in the face that begins at pixel ``begin``."""
    (row, down), (column, right) = ((each.floor().long(), (each - each.floor())[..., None]) for each in places)
    below, beside = (row + 1).clamp(max=side - 1), (column + 1).clamp(max=side - 1)
    above = cube[begin + row * side + column] * (1 - right) + cube[begin + row * side + beside] * right
    under = cube[begin + below * side + column] * (1 - right) + cube[begin + below * side + beside] * right
    return above * (1 - down) + under * down
