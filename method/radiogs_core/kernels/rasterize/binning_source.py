"""Kernels that prepare rasterization: records of surfels, the tiles that each surfel may touch, and each tile's list.

A record is a surfel as a homography of pixel rays (see ``rasterize_source``). With t = centre - eye it consists of
offset = n . t, m_u = offset axis_u - (axis_u . t) n and m_v likewise; n, m_u and m_v are in camera axes.

Tiles are computed in float64: far from the origin the rounding errors of float32 are as large as a pixel.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..native_text import native_file, native_text
from ..runtime import ITEMWISE, scalar_type, start_warp
from ..surfel.geometry import ALPHA_THRESHOLD
from .rasterize_source import TILE

_TEXT = native_file(__package__, "records.inl")


@cache
def record_kernels(dtype: torch.dtype) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type; all arrays are flat. ``pose``: camera to world."""
    start_warp()
    flat = wp.array(dtype=scalar_type(dtype))
    words = {"THRESHOLD": repr(ALPHA_THRESHOLD)}
    forward_text, backward_text = (native_text(_TEXT[part], dtype, False, words) for part in ("forward", "backward"))

    @wp.func_native(forward_text)
    def record_of(
        surfel: wp.int32, pose: flat, centre: flat, axis_u: flat, axis_v: flat, normal: flat, opacity: flat, out: flat
    ): ...

    @wp.func_native(backward_text)
    def pull_back(
        surfel: wp.int32, pose: flat, centre: flat, axis_u: flat, axis_v: flat, normal: flat, opacity: flat, pull: flat,
        to_centre: flat, to_u: flat, to_v: flat, to_normal: flat, to_opacity: flat,
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def forward(
        begin: wp.int32, pose: flat, centre: flat, axis_u: flat, axis_v: flat, normal: flat, opacity: flat, out: flat
    ):
        record_of(begin + wp.tid(), pose, centre, axis_u, axis_v, normal, opacity, out)

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def backward(
        begin: wp.int32, pose: flat, centre: flat, axis_u: flat, axis_v: flat, normal: flat, opacity: flat, pull: flat,
        to_centre: flat, to_u: flat, to_v: flat, to_normal: flat, to_opacity: flat,
    ):  # fmt: skip
        pull_back(
            begin + wp.tid(), pose, centre, axis_u, axis_v, normal, opacity, pull,
            to_centre, to_u, to_v, to_normal, to_opacity,
        )  # fmt: skip

    return SimpleNamespace(forward=forward, backward=backward)


@cache
def binning_kernels(dtype: torch.dtype) -> Any:
    """``bound``, ``entries`` and ``listed`` for surfels of a scalar type; see the kernels."""
    start_warp()
    scalar = scalar_type(dtype)
    vector = wp.types.vector(3, scalar)
    double = wp.float64
    tile = wp.constant(wp.int32(TILE))

    @wp.struct
    class Window:
        """A camera. ``pose``: its centre, then its right, down and forward axes in the world; four rows."""

        pose: wp.array(dtype=wp.vec3d)
        focal: wp.vec2d
        offset: wp.vec2d
        width: wp.int32
        height: wp.int32

    @wp.func
    def widened(value: vector):
        return wp.vec3d(double(value[0]), double(value[1]), double(value[2]))

    @wp.func
    def within(window: Window, point: wp.vec3d):
        return wp.vec3d(wp.dot(window.pose[1], point), wp.dot(window.pose[2], point), wp.dot(window.pose[3], point))

    # Pixels are clamped beside the image before they become integers: a surfel may lie 1e30 pixels away. NaN (from
    # float64 inputs beyond 1e150) gives the bounds of the whole image.
    @wp.func
    def first_pixel(position: double, size: wp.int32):
        edge = wp.ceil(position - double(0.5))
        if edge >= double(size):
            return size
        if edge > double(0.0):
            return wp.int32(edge)
        return wp.int32(0)

    @wp.func
    def last_pixel(position: double, size: wp.int32):
        edge = wp.floor(position - double(0.5))
        if edge < double(0.0):
            return wp.int32(-1)
        if edge < double(size):
            return wp.int32(edge)
        return size - wp.int32(1)

    @wp.kernel(enable_backward=False, module="unique")
    def bound(
        first: wp.int32,
        window: Window,
        centre: wp.array(dtype=vector),
        axis_u: wp.array(dtype=vector),
        axis_v: wp.array(dtype=vector),
        normal: wp.array(dtype=vector),
        radius: wp.array(dtype=scalar),
        can_be_hit: wp.array(dtype=wp.bool),
        out_tiles: wp.array(dtype=wp.vec4i),
        out_count: wp.array(dtype=wp.int64),
        out_depth: wp.array(dtype=double),
    ):
        """First and last tile (column, row) of a surfel's support ellipse, the number of tiles, and the centre's depth.

        With the ellipse C + cos(a) U + sin(a) V in camera axes, the vertical line x = q Z is a tangent if
        (C.x - q C.z)^2 = (U.x - q U.z)^2 + (V.x - q V.z)^2, which is quadratic in q. If the ellipse crosses the
        camera's plane, its image is unbounded, and every pixel may see it.
        """
        surfel = first + wp.tid()
        towards = widened(centre[surfel]) - window.pose[0]
        position = within(window, towards)
        out_depth[surfel] = position[2]
        out_count[surfel] = wp.int64(0)
        out_tiles[surfel] = wp.vec4i(0, 0, -1, -1)
        if can_be_hit[surfel] and wp.dot(widened(normal[surfel]), towards) < double(0.0):
            u = widened(axis_u[surfel])
            v = widened(axis_v[surfel])
            reach = double(radius[surfel])
            across_u = u - v * (wp.dot(u, v) / wp.dot(v, v))
            across_v = v - u * (wp.dot(u, v) / wp.dot(u, u))
            span_u = within(window, across_u) * (reach / wp.dot(across_u, across_u))
            span_v = within(window, across_v) * (reach / wp.dot(across_v, across_v))
            depth_reach = wp.sqrt(span_u[2] * span_u[2] + span_v[2] * span_v[2])
            low = wp.vec2i(0, 0)
            high = wp.vec2i(window.width - 1, window.height - 1)
            if position[2] - depth_reach > double(0.0):
                size = wp.vec2i(window.width, window.height)
                square = (position[2] - depth_reach) * (position[2] + depth_reach)
                for axis in range(2):
                    middle = position[axis] * position[2] - span_u[axis] * span_u[2] - span_v[axis] * span_v[2]
                    constant = (
                        position[axis] * position[axis] - span_u[axis] * span_u[axis] - span_v[axis] * span_v[axis]
                    )
                    width = wp.sqrt(wp.max(middle * middle - square * constant, double(0.0)))
                    scale = window.focal[axis] / square
                    low[axis] = first_pixel((middle - width) * scale + window.offset[axis], size[axis])
                    high[axis] = last_pixel((middle + width) * scale + window.offset[axis], size[axis])
            if position[2] + depth_reach > double(0.0) and high[0] >= low[0] and high[1] >= low[1]:
                tiles = wp.vec4i(low[0] // tile, low[1] // tile, high[0] // tile, high[1] // tile)
                out_tiles[surfel] = tiles
                out_count[surfel] = wp.int64(tiles[2] - tiles[0] + 1) * wp.int64(tiles[3] - tiles[1] + 1)

    @wp.kernel(enable_backward=False, module="unique")
    def entries(
        first: wp.int32,
        tiles_across: wp.int32,
        nearest_first: wp.array(dtype=wp.int64),
        begins: wp.array(dtype=wp.int64),
        tiles: wp.array(dtype=wp.vec4i),
        out_tile: wp.array(dtype=wp.int32),
        out_member: wp.array(dtype=wp.int32),
    ):
        """Write every pair of a surfel and a tile, in depth order, for sorting by tile."""
        index = first + wp.tid()
        surfel = wp.int32(nearest_first[index])
        box = tiles[surfel]
        entry = begins[index]
        for row in range(box[1], box[3] + 1):
            for column in range(box[0], box[2] + 1):
                out_tile[entry] = row * tiles_across + column
                out_member[entry] = surfel
                entry += wp.int64(1)

    @wp.kernel(enable_backward=False, module="unique")
    def listed(
        tiles_across: wp.int32,
        tile_count: wp.int32,
        nearest_first: wp.array(dtype=wp.int64),
        tiles: wp.array(dtype=wp.vec4i),
        out_starts: wp.array(dtype=wp.int32),
        out_members: wp.array(dtype=wp.int32),
    ):
        """Write the lists of all tiles by a counting sort, in one thread. ``out_starts`` has to be zero."""
        for index in range(nearest_first.shape[0]):
            box = tiles[wp.int32(nearest_first[index])]
            for row in range(box[1], box[3] + 1):
                for column in range(box[0], box[2] + 1):
                    out_starts[row * tiles_across + column] += 1
        total = wp.int32(0)
        for each in range(tile_count):
            total += out_starts[each]
            out_starts[each] = total - out_starts[each]
        for index in range(nearest_first.shape[0]):
            surfel = wp.int32(nearest_first[index])
            box = tiles[surfel]
            for row in range(box[1], box[3] + 1):
                for column in range(box[0], box[2] + 1):
                    entry = out_starts[row * tiles_across + column]
                    out_members[entry] = surfel
                    out_starts[row * tiles_across + column] = entry + 1
        # Each tile's cursor is now the start of the next tile.
        for each in range(tile_count):
            out_starts[tile_count - each] = out_starts[tile_count - each - 1]
        out_starts[0] = 0

    return SimpleNamespace(Window=Window, bound=bound, entries=entries, listed=listed, vector=vector)
