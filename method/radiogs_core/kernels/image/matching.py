"""K16: what it costs to match the pixels of a view with other views at a row of depths. On the CPU; no gradient."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import pad

from ...scene.camera import Camera
from ..runtime import launch_in_parallel
from .matching_source import PIXELS_AT_ONCE, TEXEL, scratch_of, sweep_kernel


@dataclass(frozen=True)
class Matched:
    """The covered pixels of a view, as they are matched.

    covered: those of a box of pixels. directions: world vectors of unit depth through them, row by row. colour: display
    sRGB.
    """

    camera: Camera
    covered: Bool[Tensor, "rows columns"]
    directions: Float[Tensor, "pixels 3"]
    colour: Float[Tensor, "3 pixels"]


class Textures:
    """The images of all views, display sRGB times coverage, and coverage: in one memory, a texel a pixel."""

    def __init__(self, cameras: Sequence[Camera], colours: Sequence[Tensor], covered: Sequence[Tensor]) -> None:
        self.cameras = cameras
        maps = [
            pad(torch.cat([colour, inside[None].to(colour)]).permute(1, 2, 0), (0, 0, 1, 1, 1, 1)).flatten()
            for colour, inside in zip(colours, covered, strict=True)
        ]
        self.memory = torch.cat(maps)
        ends = accumulate(len(each) for each in maps)
        self.begin = [end - len(each) for end, each in zip(ends, maps, strict=True)]


def matching_costs(
    matched: Matched,
    textures: Textures,
    others: Sequence[int],
    planes: Float[Tensor, " planes"],
    window: int,
    agreeing: int,
) -> Float[Tensor, "planes rows columns"]:
    """For each pixel of the box and each depth, the mean of the ``agreeing`` least differences to the other views.

    A difference is that of colours (mean of three, absolute), 1 where the other view sees no object there, averaged
    over the covered pixels of the square of ``window`` pixels a side (odd) about the pixel. ``others``: numbers of
    textures, at least one. ``planes``: z-depths in the view's camera, world units.
    """
    (rows, columns), reach, dtype = matched.covered.shape, window // 2, planes.dtype
    spare = -len(matched.directions) % PIXELS_AT_ONCE
    projections = [_projected(matched, textures.cameras[other]) for other in others]
    begins, slopes = (torch.stack(kind) for kind in zip(*projections, strict=True))
    sizes = [(textures.cameras[other].width, textures.cameras[other].height, textures.begin[other]) for other in others]
    row, column = matched.covered.nonzero().unbind(1)
    wide, high = columns + 2 * reach, rows + 2 * reach
    place = pad(((row + reach) * wide + column + reach).int(), (0, spare), value=high * wide)
    colours = pad(matched.colour.T, (0, TEXEL - 3, 0, spare)).to(dtype)
    room = planes.new_empty(len(planes) * scratch_of(rows, columns, window, agreeing))
    out = planes.new_empty(len(planes), rows, columns)
    given = [planes, place, colours, pixels_inside(matched.covered, window).to(dtype), begins, pad(slopes, (0, spare))]
    arguments = [rows, columns, len(place), len(others), window, agreeing, *given]
    arguments += [torch.tensor(sizes, dtype=torch.int32), textures.memory, room, out]
    launch_in_parallel(sweep_kernel(dtype), len(planes), planes.device, lambda _: arguments)
    return out


def _projected(matched: Matched, other: Camera) -> tuple[Float[Tensor, "3"], Float[Tensor, "3 pixels"]]:
    """Homogeneous pixels of another camera: where the view's centre falls, and what a unit of depth adds to it."""
    to_pixels = torch.tensor(
        [[other.fx, 0.0, other.cx - 0.5], [0.0, other.fy, other.cy - 0.5], [0.0, 0.0, 1.0]],
        dtype=matched.directions.dtype,
    )
    to_pixels = to_pixels @ other.axes.T
    return to_pixels @ (matched.camera.centre - other.centre), to_pixels @ matched.directions.T


def pixels_inside(covered: Bool[Tensor, "rows columns"], window: int) -> Float[Tensor, "rows columns"]:
    """How many covered pixels lie in the square of ``window`` pixels a side about each pixel, at least 1."""
    square = torch.ones(1, 1, window, window)
    return torch.nn.functional.conv2d(covered[None, None].float(), square, padding=window // 2)[0, 0].clamp(min=1)
