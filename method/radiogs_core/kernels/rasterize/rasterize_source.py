"""Kernels that blend the surfels of a tile front to back, forward and backward.

A surfel is a homography from the pixel ray d (camera axes, z-depth 1) to its plane: with
n' = normal, m_u = (axis_u . (o - c)) n' + (n' . (c - o)) axis_u, all in camera axes,

    t = offset / (n' . d),   u = (m_u . d) / (n' . d),   v = (m_v . d) / (n' . d),

so a hit costs three dot products; ``projection`` applies the chain rule to centre, axes and normal.

Both passes are native snippets whose item on the CPU is a tile: its pixels are the lanes of vectors, and a surfel has
weight zero in lanes that it does not cover. Arranged for CUDA, an item is a pixel: the same text with one lane.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..lanes import LANES, bell_words
from ..native_text import native_file, native_text
from ..runtime import NATIVE, scalar_type, start_warp
from ..surfel.geometry import MAX_ALPHA, RASTER_TRANSMITTANCE_STOP

_TEXT = native_file(__package__, "rasterize.inl", lanes=LANES)

TILE = 4
"""Side of a tile in pixels: its 16 pixels are one or two vector registers."""

RECORD = 12
"""Scalars of a surfel's record: n' (3), m_u (3), m_v (3), offset, opacity, squared support radius."""

PLANES = 4
"""Images beside the channels: alpha, depth, mean depth, distortion."""

PIXEL_SUMS = 5
"""Sums stored for each pixel for the backward pass: sum w, sum w z, distortion, sum w m, sum w m^2, with
m = z / depth_unit."""


def pixels_an_item(on_cuda: bool) -> int:
    """Number of pixels that one item of the kernels blends."""
    return 1 if on_cuda else TILE * TILE


@cache
def blend_kernels(dtype: torch.dtype, channels: int, on_cuda: bool) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type and a number of feature channels; all arrays are flat.

    ``lens``: fx, fy, cx, cy. ``size``: width and height of the image, and tiles in a row. ``planes``: an address for
    each channel and each of the PLANES, so that images need not lie together. ``strides``: numbers from pixel to pixel
    of each channel.
    """
    start_warp()
    scalar = scalar_type(dtype)
    flat = wp.array(dtype=scalar)
    integers = wp.array(dtype=wp.int32)
    Lens = wp.types.vector(4, scalar)
    Planes = wp.types.vector(channels + PLANES, wp.uint64)
    Strides = wp.types.vector(channels, wp.int32)

    @wp.func_native(_written_for(_TEXT["forward"], dtype, channels, on_cuda))
    def blend_item(
        item: wp.int32, lens: Lens, size: wp.vec3i, depth_unit: scalar, starts: integers, members: integers,
        records: flat, features: flat, planes: Planes, strides: Strides,
        out_sums: flat, out_end: integers, out_blended: integers,
    ): ...  # fmt: skip

    @wp.func_native(_written_for(_TEXT["backward"], dtype, channels, on_cuda))
    def pull_item(
        item: wp.int32, lens: Lens, size: wp.vec3i, depth_unit: scalar, starts: integers, members: integers,
        records: flat, features: flat, planes: Planes, strides: Strides, pulls: Planes,
        sums: flat, ends: integers, grad_records: flat, grad_features: flat,
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def forward(
        first: wp.int32, lens: Lens, size: wp.vec3i, depth_unit: scalar, starts: integers, members: integers,
        records: flat, features: flat, planes: Planes, strides: Strides,
        out_sums: flat, out_end: integers, out_blended: integers,
    ):  # fmt: skip
        blend_item(
            first + wp.tid(), lens, size, depth_unit, starts, members, records, features, planes, strides,
            out_sums, out_end, out_blended,
        )  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def backward(
        first: wp.int32, lens: Lens, size: wp.vec3i, depth_unit: scalar, starts: integers, members: integers,
        records: flat, features: flat, planes: Planes, strides: Strides, pulls: Planes,
        sums: flat, ends: integers, grad_records: flat, grad_features: flat,
    ):  # fmt: skip
        pull_item(
            first + wp.tid(), lens, size, depth_unit, starts, members, records, features, planes, strides, pulls,
            sums, ends, grad_records, grad_features,
        )  # fmt: skip

    return SimpleNamespace(Lens=Lens, Planes=Planes, Strides=Strides, forward=forward, backward=backward)


def _written_for(snippet: str, dtype: torch.dtype, channels: int, on_cuda: bool) -> str:
    words = {
        "PIXELS_AN_ITEM": str(pixels_an_item(on_cuda)),
        "TILE": str(TILE),
        "RECORD": str(RECORD),
        "CHANNELS": str(channels),
        "SUMS": str(PIXEL_SUMS),
        "MAX_ALPHA": repr(MAX_ALPHA),
        "STOP": repr(RASTER_TRANSMITTANCE_STOP),
        "ROWS": str(_rows(channels, on_cuda)),
        **bell_words(dtype),
    }
    return native_text(snippet, dtype, on_cuda, words)


def _rows(channels: int, on_cuda: bool) -> int:
    """Number of a surfel's gradients, on the CPU rounded up to a multiple of the lanes; extra ones are zero."""
    rows, lanes = RECORD - 1 + channels, pixels_an_item(on_cuda)
    return -(-rows // lanes) * lanes
