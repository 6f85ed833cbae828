"""K16: the cost of matching the pixels of a view with other views at a sequence of depths; on the CPU, no gradient."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import accumulate

import torch
import warp as wp
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import conv2d, pad

from ...scene.camera import Camera
from ..native_kernel import INTEGERS, flat, native_file, native_kernel
from ..runtime import NATIVE, launch_in_parallel

MATCHING = native_file(__package__, "matching.inl")

PIXELS_AT_ONCE = 16
"""Pixels that are processed together; padding pixels write to an extra entry behind all others."""

COVERED = 0.5
"""Coverage above which a pixel shows the object."""

TEXEL = 4
"""Numbers of a texel in memory: three colours and coverage."""


@dataclass(frozen=True)
class Matched:
    """The covered pixels of a view that are matched with other views."""

    camera: Camera
    """Camera of the view."""
    covered: Bool[Tensor, "rows columns"]
    """Whether each pixel is covered, in the box of pixels around all covered ones."""
    directions: Float[Tensor, "pixels 3"]
    """World vectors through the covered pixels, with z-depth 1; row by row."""
    colour: Float[Tensor, "3 pixels"]
    """Display sRGB of the covered pixels."""


class Textures:
    """The images of all views in one buffer: colour (display sRGB times coverage) and coverage of each pixel.

    Args:
        cameras: Cameras of the views.
        colours: Colours of each view [3, height, width].
        covered: Whether each pixel of each view is covered [height, width].
    """

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
    """For each pixel of the box and each depth, the mean of the ``agreeing`` smallest differences to other views.

    A difference is the absolute colour difference (mean of three channels), or 1 if the other view shows no object
    there, averaged over the covered pixels of a square around the pixel.

    Args:
        matched: Pixels that are matched.
        textures: Images of all views.
        others: Indices of the other views in ``textures``; at least one.
        planes: z-depths in the view's camera, world units.
        window: Side of the square, in pixels; odd.
        agreeing: Number of views that count.
    """
    (rows, columns), reach, dtype = matched.covered.shape, window // 2, planes.dtype
    spare = -len(matched.directions) % PIXELS_AT_ONCE
    projections = [_projected(matched, textures.cameras[other]) for other in others]
    begins, slopes = (torch.stack(kind) for kind in zip(*projections, strict=True))
    sizes = [(textures.cameras[other].width, textures.cameras[other].height, textures.begin[other]) for other in others]
    row, column = matched.covered.nonzero().unbind(1)
    wide, high = columns + 2 * reach, rows + 2 * reach
    targets = pad(((row + reach) * wide + column + reach).int(), (0, spare), value=high * wide)
    colours = pad(matched.colour.T, (0, TEXEL - 3, 0, spare)).to(dtype)
    room = planes.new_empty(len(planes) * (high * wide + 1 + agreeing * rows * columns + wide + columns))
    out = planes.new_empty(len(planes), rows, columns)
    square = torch.ones(1, 1, window, window)
    inside = conv2d(matched.covered[None, None].float(), square, padding=reach)[0, 0].clamp(min=1).to(dtype)
    arguments = [
        rows, columns, len(targets), len(others), window, agreeing, planes, targets, colours, inside, begins,
        pad(slopes, (0, spare)), torch.tensor(sizes, dtype=torch.int32), textures.memory, room, out,
    ]  # fmt: skip
    launch_in_parallel(sweep_kernel(dtype), len(planes), planes.device, arguments)
    return out


@cache
def sweep_kernel(dtype: torch.dtype) -> wp.Kernel:
    """The kernel for a scalar type; an item is a plane, with a loop over the other views."""
    parameters = (
        (wp.int32, "rows columns pixels others window agreeing"),
        (flat(dtype), "planes"),
        (INTEGERS, "targets"),
        (flat(dtype), "colours inside begins slopes"),
        (INTEGERS, "sizes"),
        (flat(dtype), "textures room out"),
    )
    words = {"TEXEL": TEXEL, "COVERED": COVERED, "PIXELS_AT_ONCE": PIXELS_AT_ONCE}
    return native_kernel(MATCHING, dtype, NATIVE, "sweep", "plane", *parameters, words=words)


def _projected(matched: Matched, other: Camera) -> tuple[Float[Tensor, "3"], Float[Tensor, "3 pixels"]]:
    """Homogeneous image coordinates in another camera: of the view's centre, and of a unit of depth along each ray."""
    to_pixels = torch.tensor(
        [[other.fx, 0.0, other.cx - 0.5], [0.0, other.fy, other.cy - 0.5], [0.0, 0.0, 1.0]],
        dtype=matched.directions.dtype,
    )
    to_pixels = to_pixels @ other.axes.T
    return to_pixels @ (matched.camera.centre - other.centre), to_pixels @ matched.directions.T
